//! Arbitrary and mutated bytes: every reader answers, none panics, and none allocates
//! more than a small multiple of its limits and its input.

#![allow(clippy::unwrap_used, reason = "this is test code")]

mod support;

use proptest::prelude::*;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use steadymesh_draco::{EncodeOptions, MeshView, encode_with_info};
use steadymesh_mesh_io::{Format, ImageFormat, Limits, glb, obj, ply, read, sniff};
use support::tetrahedron;

/// Counts what the current thread holds, so that tests can run side by side.
struct Counting;

thread_local! {
    static HELD: Cell<isize> = const { Cell::new(0) };
    static PEAK: Cell<isize> = const { Cell::new(0) };
}

fn count(change: isize) {
    // Fails only while the thread ends; nothing is measured then.
    let _ = HELD.try_with(|held| {
        held.set(held.get() + change);
        let _ = PEAK.try_with(|peak| peak.set(peak.get().max(held.get())));
    });
}

#[allow(
    unsafe_code,
    reason = "a counting allocator can only be written this way"
)]
// SAFETY: every call is handed on to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as isize);
        // SAFETY: the caller keeps the contract of `alloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count(-(layout.size() as isize));
        // SAFETY: `pointer` came from `alloc` above, with this layout.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

const FORMATS: [Format; 5] = [
    Format::Obj,
    Format::Ply,
    Format::Glb,
    Format::Drc,
    Format::Native,
];
const LIMITS: Limits = Limits {
    max_vertices: 1_000,
    max_faces: 1_000,
    max_memory_bytes: 1 << 20,
};

/// Reads with every reader and checks what comes out and what it cost.
fn read_all(bytes: &[u8]) {
    let _ = sniff(bytes);
    for format in FORMATS {
        let before = HELD.get();
        PEAK.set(before);
        let result = read(bytes, format, &LIMITS);
        let peak = usize::try_from(PEAK.get() - before).unwrap();
        let allowed = (1 << 20) + 40 * bytes.len();
        assert!(
            peak <= allowed,
            "{format:?} held {peak} bytes for {}",
            bytes.len()
        );
        let Ok(mesh) = result else { continue };
        assert!(mesh.positions.len() <= LIMITS.max_vertices);
        assert!(!mesh.faces.is_empty() && mesh.faces.len() <= LIMITS.max_faces);
        assert!(
            mesh.positions
                .iter()
                .flatten()
                .all(|value| value.is_finite())
        );
        let count = mesh.positions.len();
        assert!(
            mesh.faces
                .iter()
                .flatten()
                .all(|&index| (index as usize) < count)
        );
        for write in [obj::write, ply::write, |mesh: &_| glb::write(mesh, None)] {
            assert!(!write(&mesh).is_empty());
        }
    }
}

/// As much of an image as is looked at.
const PNG: &[u8] = b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR\0\0\0\x08\0\0\0\x04";

fn valid_files() -> Vec<Vec<u8>> {
    let mesh = tetrahedron();
    let positions: Vec<[f32; 3]> = mesh.positions.iter().map(|p| p.map(|v| v as f32)).collect();
    let view = MeshView {
        positions: &positions,
        point_vertices: None,
        faces: &mesh.faces,
        normals: None,
        colors: None,
        materials: None,
        texture_coordinates: Some(&[[0.0; 2], [1.0, 0.0], [0.0, 1.0], [0.25, 0.75]]),
    };
    let encoded = encode_with_info(&view, &EncodeOptions::default()).unwrap();
    let parts = glb::DracoPart::split(&encoded.bytes, &LIMITS).unwrap();
    let ascii = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
                 property float z\nelement face 1\nproperty list uchar int vertex_indices\n\
                 end_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    vec![
        obj::write(&mesh),
        ply::write(&mesh),
        ascii.as_bytes().to_vec(),
        ascii.replace("0 0 0\n1 0 0", "0 0\n0 1 0 0").into_bytes(),
        ascii.replace('\n', "\r").into_bytes(),
        glb::write(&mesh, None),
        gltf().into_bytes(),
        glb::wrap_draco(&parts, None),
        glb::wrap_draco(&parts, Some((ImageFormat::Png, PNG))),
        glb::write(&mesh, Some((ImageFormat::Webp, PNG))),
        steadymesh_proto::Bundle {
            seq: Some(1),
            capture_time_us: None,
            mesh: &obj::write(&mesh),
            image: PNG,
        }
        .encode(),
        encoded.bytes,
    ]
}

/// A triangle as glTF text, its points in base64 and its corners in percents.
fn gltf() -> String {
    let points = format!("{}AACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA", "A".repeat(16));
    format!(
        "{{\"asset\":{{\"version\":\"2.0\"}},\"buffers\":[{{\"byteLength\":36,\"uri\":\
         \"data:;base64,{points}\"}},{{\"byteLength\":3,\"uri\":\"data:,%00%01%02\"}}],\
         \"bufferViews\":[{{\"buffer\":0,\"byteLength\":36}},{{\"buffer\":1,\"byteLength\":3}}],\
         \"accessors\":[{{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"}},\
         {{\"bufferView\":1,\"componentType\":5121,\"count\":3,\"type\":\"SCALAR\"}}],\
         \"meshes\":[{{\"primitives\":[{{\"attributes\":{{\"POSITION\":0}},\"indices\":1}}]}}]}}"
    )
}

/// Digits, separators and extremes, where a random byte would only break the syntax.
const SNIPPETS: [&[u8]; 20] = [
    b"9",
    b"-",
    b"0",
    b"e",
    b".",
    b"/",
    b" ",
    b"\n",
    b"\\\n",
    b"nan",
    b"99999999999",
    b"\xff",
    b"\x00",
    b"\xff\xff\xff\xff",
    b"1e308",
    b"vertex",
    b"\r",
    b"%",
    b"\"",
    b"=",
];

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2_000))]

    #[test]
    fn arbitrary_bytes_are_survived(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        read_all(&bytes);
        for prefix in [&b"ply\nformat ascii 1.0\n"[..], b"glTF\x02\0\0\0", b"DRACO\x02\x02", b"v 0 0 0\n", b"{\"asset\":"] {
            read_all(&[prefix, &bytes].concat());
        }
    }

    #[test]
    fn mutated_files_are_survived(
        file in 0_usize..9,
        edits in prop::collection::vec((any::<prop::sample::Index>(), 0_usize..20, any::<bool>()), 1..6),
        cut in prop::option::weighted(0.2, any::<prop::sample::Index>()),
    ) {
        let mut bytes = valid_files().swap_remove(file);
        for (place, snippet, replaces) in edits {
            let at = place.index(bytes.len());
            let snippet = SNIPPETS[snippet];
            let end = if replaces { (at + snippet.len()).min(bytes.len()) } else { at };
            bytes.splice(at..end, snippet.iter().copied());
        }
        if let Some(cut) = cut {
            bytes.truncate(cut.index(bytes.len()));
        }
        read_all(&bytes);
    }
}

#[test]
fn every_cut_of_every_valid_file_is_survived() {
    for file in valid_files() {
        for length in 0..=file.len() {
            read_all(&file[..length]);
        }
    }
}

#[test]
fn each_valid_file_is_recognized_and_read() {
    for file in valid_files() {
        let format = sniff(&file).unwrap();
        assert!(read(&file, format, &LIMITS).is_ok());
    }
}
