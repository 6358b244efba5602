/** Draco bytes to typed arrays. */

import { vertexNormals } from "./normals.js";

/**
 * A triangle mesh, ready for vertex buffers. Each attribute has one value per point; a vertex on a
 * texture's seam is several points at the same position.
 */
export interface DecodedMesh {
  /** x, y, z, in the rig's unit. */
  positions: Float32Array<ArrayBuffer>;
  /** x, y, z of length one: the rig's, else the sum of the faces around, weighted by area. */
  normals: Float32Array<ArrayBuffer>;
  /** Red, green, blue, alpha, 0 to 255, sRGB; `null` if the rig sends none. */
  colors: Uint8Array<ArrayBuffer> | null;
  /** u, v from the lower left corner of the image; `null` if the rig sends none. */
  uvs: Float32Array<ArrayBuffer> | null;
  /** The number of each point's material, which all points of a face share; `null` if there is one. */
  materials: Uint16Array<ArrayBuffer> | null;
  /** Three points a face, counterclockwise seen from outside. */
  indices: Uint32Array<ArrayBuffer>;
}

/** A mesh that Draco refused, or a decoder that did not answer. */
export class DecodeError extends Error {
  override name = "DecodeError";
}

/** An object of the WebAssembly module's memory. */
interface Handle {
  readonly ptr?: number;
}

interface DracoStatus extends Handle {
  ok(): boolean;
  error_msg(): string;
}

interface DracoMesh extends Handle {
  num_points(): number;
  num_faces(): number;
}

interface DracoAttribute extends Handle {
  num_components(): number;
}

interface DracoDecoder extends Handle {
  DecodeArrayToMesh(bytes: Uint8Array, length: number, mesh: DracoMesh): DracoStatus;
  GetAttributeId(mesh: DracoMesh, type: number): number;
  GetAttributeIdByMetadataEntry(mesh: DracoMesh, name: string, value: string): number;
  GetAttribute(mesh: DracoMesh, id: number): DracoAttribute;
  GetTrianglesUInt32Array(mesh: DracoMesh, bytes: number, pointer: number): boolean;
  GetAttributeDataArrayForAllPoints(
    mesh: DracoMesh,
    attribute: DracoAttribute,
    type: number,
    bytes: number,
    pointer: number,
  ): boolean;
}

export interface DracoModule {
  Decoder: new () => DracoDecoder;
  Mesh: new () => DracoMesh;
  HEAPU8: Uint8Array<ArrayBuffer>;
  POSITION: number;
  NORMAL: number;
  COLOR: number;
  TEX_COORD: number;
  DT_FLOAT32: number;
  DT_UINT8: number;
  DT_UINT16: number;
  _malloc(bytes: number): number;
  _free(pointer: number): void;
  destroy(handle: Handle): void;
}

export interface DracoOptions {
  instantiateWasm?(
    imports: WebAssembly.Imports,
    receive: (instance: WebAssembly.Instance) => void,
  ): object;
  wasmBinary?: ArrayBuffer;
}

/**
 * Decodes one mesh.
 *
 * @throws {DecodeError}
 */
export function decodeMesh(draco: DracoModule, bytes: Uint8Array): DecodedMesh {
  const decoder = new draco.Decoder();
  const mesh = new draco.Mesh();
  try {
    const status = decoder.DecodeArrayToMesh(bytes, bytes.length, mesh);
    if (!status.ok()) throw new DecodeError(status.error_msg() || "not a Draco mesh");
    return read(draco, decoder, mesh);
  } finally {
    draco.destroy(mesh);
    draco.destroy(decoder);
  }
}

function read(draco: DracoModule, decoder: DracoDecoder, mesh: DracoMesh): DecodedMesh {
  const points = mesh.num_points();
  const values = (id: number, components: number, valueType: number, size: number) => {
    if (id < 0) return null;
    const found = decoder.GetAttribute(mesh, id);
    if (found.num_components() !== components) return null;
    return copy(draco, points * components * size, (pointer, length) =>
      decoder.GetAttributeDataArrayForAllPoints(mesh, found, valueType, length, pointer),
    );
  };
  const attribute = (type: number, components: number, valueType: number, size: number) =>
    values(decoder.GetAttributeId(mesh, type), components, valueType, size);
  const floats = (type: number, components: number) => {
    const buffer = attribute(type, components, draco.DT_FLOAT32, 4);
    return buffer === null ? null : new Float32Array(buffer);
  };
  const positions = floats(draco.POSITION, 3);
  if (positions === null) throw new DecodeError("the mesh has no positions");
  const indices = new Uint32Array(
    copy(draco, mesh.num_faces() * 12, (pointer, length) =>
      decoder.GetTrianglesUInt32Array(mesh, length, pointer),
    ),
  );
  const rgba = attribute(draco.COLOR, 4, draco.DT_UINT8, 1);
  const rgb = rgba === null ? attribute(draco.COLOR, 3, draco.DT_UINT8, 1) : null;
  const material = decoder.GetAttributeIdByMetadataEntry(mesh, "name", "material");
  const materials = values(material, 1, draco.DT_UINT16, 2);
  return {
    positions,
    normals: floats(draco.NORMAL, 3) ?? vertexNormals(positions, indices),
    colors: rgba !== null ? new Uint8Array(rgba) : rgb !== null ? withAlpha(rgb) : null,
    uvs: floats(draco.TEX_COORD, 2),
    materials: materials === null ? null : new Uint16Array(materials),
    indices,
  };
}

/** Has Draco write into its own memory, which may have moved by then, and copies it out. */
function copy(
  draco: DracoModule,
  bytes: number,
  fill: (pointer: number, bytes: number) => boolean,
): ArrayBuffer {
  const pointer = draco._malloc(Math.max(bytes, 1));
  try {
    if (!fill(pointer, bytes)) throw new DecodeError("Draco gave no values");
    return draco.HEAPU8.slice(pointer, pointer + bytes).buffer;
  } finally {
    draco._free(pointer);
  }
}

function withAlpha(rgb: ArrayBuffer): Uint8Array<ArrayBuffer> {
  const from = new Uint8Array(rgb);
  const to = new Uint8Array((from.length / 3) * 4).fill(255);
  for (let point = 0; point * 3 < from.length; point += 1) {
    to.set(from.subarray(point * 3, point * 3 + 3), point * 4);
  }
  return to;
}
