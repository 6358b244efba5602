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
  }

  interface Int8Output {
    GetValue(at: number): number;
  }

  const createEncoder: (options: object) => Promise<{
    Encoder: new () => Encoder;
    MeshBuilder: new () => MeshBuilder;
    Mesh: new () => object;
    DracoInt8Array: new () => Int8Output;
    POSITION: number;
    NORMAL: number;
    COLOR: number;
    TEX_COORD: number;
  }>;
  export default createEncoder;
}
