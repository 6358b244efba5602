/** Volumetric video from a Steadymesh server, in the browser. */

export { AddressError, type Place, parseAddress, pathOf } from "./address.js";
export { type DecodedFrame, type EncodedFrame, FrameDecoder } from "./frames.js";
export type { LinkHandlers, LinkState } from "./link.js";
export type {
  RecordedFrame,
  RecordedFrames,
  RecordingSummary,
  StreamConfig,
  StreamSummary,
  TrackSummary,
} from "./lists.js";
export {
  type ControlMessage,
  type Frame,
  ProtocolError,
  parseControl,
  parseFrame,
  SUBPROTOCOL,
} from "./message.js";
export {
  type Consistency,
  type DistancePair,
  type DistanceStatistics,
  type FrameMetrics,
  type MeshSize,
  type OutputSize,
  parseMetrics,
  type TextureReference,
} from "./metrics.js";
export { OrderedWork } from "./ordered.js";
export { Playback, type PlaybackOptions, type Position } from "./playback.js";
export { DecoderPool, type PoolOptions } from "./pool.js";
export { ProblemError, Server, type ServerOptions, type Token } from "./server.js";
export {
  type LiveSession,
  type PlayOptions,
  type PlaySession,
  play,
  type SessionOptions,
  type WatchOptions,
  type WatchSession,
  watch,
} from "./session.js";
export { Subscription, type SubscriptionOptions, type TextureMode } from "./subscription.js";
export { type FrameTexture, TextureStore, type TextureStoreOptions } from "./textures.js";
export { type DecodedMesh, DecodeError } from "./worker/decode.js";
