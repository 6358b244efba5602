//! Any bytes as every message of the wire contract.

#![no_main]

use libfuzzer_sys::fuzz_target;
use steadymesh_proto::stream::{ControlMessage, PublishReply, PublisherMessage, StreamConfig};
use steadymesh_proto::{DeliveredFrame, NativeFrame};

fuzz_target!(|bytes: &[u8]| {
    if let Ok(frame) = DeliveredFrame::decode(bytes) {
        assert_eq!(
            DeliveredFrame::decode(&frame.encode()).unwrap().mesh,
            frame.mesh
        );
    }
    let _ = NativeFrame::stamps(bytes);
    let _ = serde_json::from_slice::<StreamConfig>(bytes);
    let _ = serde_json::from_slice::<ControlMessage>(bytes);
    let _ = serde_json::from_slice::<PublishReply>(bytes);
    let _ = serde_json::from_slice::<PublisherMessage>(bytes);
});
