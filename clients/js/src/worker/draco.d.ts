/** What is used of Draco's decoder, whose package has no types. */

declare module "draco3d/draco_decoder_nodejs.js" {
  const createDecoder: (
    options: import("./decode.js").DracoOptions,
  ) => Promise<import("./decode.js").DracoModule>;
  export default createDecoder;
}
