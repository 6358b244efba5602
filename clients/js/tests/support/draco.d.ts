/** What the tests use of Draco's encoder, whose package has no types. */

declare module "draco3d/draco_encoder_nodejs.js" {
  interface Encoder {
    SetAttributeQuantization(type: number, bits: number): void;
    EncodeMeshToDracoBuffer(mesh: object, output: Int8Output): number;
  }

  interface MeshBuilder {
    AddFacesToMesh(mesh: object, count: number, faces: number[]): void;
    AddFloatAttributeToMesh(
      mesh: object,
      type: number,
      points: number,
      size: number,
      values: number[],
    ): void;
    AddUInt8Attribute(
      mesh: object,
      type: number,
      points: number,
      size: number,
      values: number[],
    ): void;
    AddUInt16Attribute(
      mesh: object,
      type: number,
      points: number,
      size: number,
      values: number[],
    ): number;
    SetMetadataForAttribute(mesh: object, id: number, metadata: object): void;
  }

  interface MetadataBuilder {
    AddStringEntry(metadata: object, name: string, value: string): void;
  }

  interface Int8Output {
    GetValue(at: number): number;
  }

  const createEncoder: (options: object) => Promise<{
    Encoder: new () => Encoder;
    MeshBuilder: new () => MeshBuilder;
    Metadata: new () => object;
    MetadataBuilder: new () => MetadataBuilder;
    Mesh: new () => object;
    DracoInt8Array: new () => Int8Output;
    POSITION: number;
    NORMAL: number;
    COLOR: number;
    TEX_COORD: number;
    GENERIC: number;
  }>;
  export default createEncoder;
}
