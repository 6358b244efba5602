/** Messages and meshes to test with. */

import { readFile } from "node:fs/promises";
import createEncoder from "draco3d/draco_encoder_nodejs.js";
import { HEADER_BYTES } from "../../src/message.js";

/** A golden message of `proto/vectors`, which every client has to read alike. */
export async function vector(name: string): Promise<ArrayBuffer> {
  const bytes = await readFile(new URL(`../../../../proto/vectors/${name}`, import.meta.url));
  return new Uint8Array(bytes).buffer;
}

export const MESH = [0x44, 0x52, 0x41, 0x43, 0x4f];

/** A binary message: header, metrics, `MESH`, and an image if there is one. */
export function message(metrics: string, image: number[] = []): ArrayBuffer {
  const json = new TextEncoder().encode(metrics);
  const bytes = new Uint8Array(HEADER_BYTES + json.length + MESH.length + image.length);
  const view = new DataView(bytes.buffer);
  bytes.set(new TextEncoder().encode("SMDF"));
  view.setUint16(4, 1, true);
  view.setUint16(6, image.length > 0 ? 1 : 0, true);
  view.setUint32(8, json.length, true);
  view.setUint32(12, MESH.length, true);
  bytes.set(json, HEADER_BYTES);
  bytes.set(MESH, HEADER_BYTES + json.length);
  bytes.set(image, HEADER_BYTES + json.length + MESH.length);
  return bytes.buffer;
}

/** Metrics of a frame with an image of this name. */
export function metricsWithImage(seq: number, id: string): string {
  return JSON.stringify({ seq, texture: { id, media_type: "image/png", bytes: 3 } });
}

export interface MeshValues {
  positions: number[];
  faces: number[];
  uvs?: number[];
  normals?: number[];
  colors?: number[];
  materials?: number[];
}

/** The mesh in Draco's bytes, by Draco's own encoder. */
export async function encodeMesh(values: MeshValues): Promise<Uint8Array> {
  const draco = await createEncoder({});
  const encoder = new draco.Encoder();
  const builder = new draco.MeshBuilder();
  const mesh = new draco.Mesh();
  const points = values.positions.length / 3;
  builder.AddFacesToMesh(mesh, values.faces.length / 3, values.faces);
  const floats = (type: number, size: number, list: number[] | undefined) => {
    if (list !== undefined) builder.AddFloatAttributeToMesh(mesh, type, points, size, list);
  };
  floats(draco.POSITION, 3, values.positions);
  floats(draco.TEX_COORD, 2, values.uvs);
  floats(draco.NORMAL, 3, values.normals);
  if (values.colors !== undefined) {
    const size = values.colors.length / points;
    builder.AddUInt8Attribute(mesh, draco.COLOR, points, size, values.colors);
  }
  if (values.materials !== undefined) {
    const id = builder.AddUInt16Attribute(mesh, draco.GENERIC, points, 1, values.materials);
    const metadata = new draco.Metadata();
    new draco.MetadataBuilder().AddStringEntry(metadata, "name", "material");
    builder.SetMetadataForAttribute(mesh, id, metadata);
  }
  encoder.SetAttributeQuantization(draco.POSITION, 16);
  const output = new draco.DracoInt8Array();
  const length = encoder.EncodeMeshToDracoBuffer(mesh, output);
  return Uint8Array.from({ length }, (_, i) => output.GetValue(i) & 255);
}
