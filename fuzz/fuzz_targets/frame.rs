//! Any bytes as a frame, all the way through repair and simplification.

#![no_main]

use libfuzzer_sys::fuzz_target;
use steadymesh::pipeline::{
    AttributeWeight, PreparedFrame, Previous, RawFrame, Settings, TargetSize, process,
};
use steadymesh_mesh_io::{Limits, read, sniff};

const LIMITS: Limits = Limits {
    max_vertices: 2_000,
    max_faces: 4_000,
    max_memory_bytes: 16 << 20,
};

fuzz_target!(|bytes: &[u8]| {
    let Some(format) = sniff(bytes) else { return };
    let Ok(mesh) = read(bytes, format, &LIMITS) else {
        return;
    };
    let raw = RawFrame::from_mesh(mesh, bytes.len());
    let Ok(frame) = PreparedFrame::new(raw, &mut ()) else {
        return;
    };
    let settings = Settings {
        target: TargetSize::Ratio(0.3),
        attribute_weight: AttributeWeight::new(0.01).unwrap(),
        ..Settings::default()
    };
    // A frame that has passed the edge comes out, whatever its shape.
    let first = process(&frame, None, &settings, &mut ()).unwrap();
    assert!(
        first
            .output
            .mesh
            .positions()
            .iter()
            .all(|p| p.coords.iter().all(|c| c.is_finite()))
    );
    let previous = Previous {
        frame: &frame,
        output: Some(&first.output),
    };
    let second = process(&frame, Some(previous), &settings, &mut ()).unwrap();
    assert!(second.output.mesh.face_count() <= frame.mesh().face_count());
});
