//! Bytes that nobody's encoder wrote: no crash, no flood of memory.

#![allow(clippy::unwrap_used, reason = "this is test code")]

use steadymesh_draco::{
    DecodeError, DecodeLimits, EncodeOptions, MeshView, decode, encode, last_decode_peak_bytes,
};

const MEMORY: usize = 16 << 20;
const LIMITS: DecodeLimits = DecodeLimits {
    max_vertices: 1 << 20,
    max_faces: 1 << 20,
    max_memory_bytes: MEMORY,
};
const ANY_COUNT: DecodeLimits = DecodeLimits {
    max_vertices: usize::MAX,
    max_faces: usize::MAX,
    max_memory_bytes: MEMORY,
};

/// A closed surface of `n` by `n` quads, the shape of a doughnut.
fn doughnut(n: u32, speed: u8) -> Vec<u8> {
    let angle = |i: u32| std::f32::consts::TAU * i as f32 / n as f32;
    let positions: Vec<[f32; 3]> = (0..n * n)
        .map(|i| {
            let (u, v) = (angle(i % n), angle(i / n));
            let ring = 3.0 + v.cos();
            [ring * u.cos(), ring * u.sin(), v.sin()]
        })
        .collect();
    let at = |x: u32, y: u32| (y % n) * n + x % n;
    let faces: Vec<[u32; 3]> = (0..n * n)
        .flat_map(|i| {
            let (x, y) = (i % n, i / n);
            let far = at(x + 1, y + 1);
            [[at(x, y), at(x + 1, y), far], [at(x, y), far, at(x, y + 1)]]
        })
        .collect();
    let uv: Vec<[f32; 2]> = positions.iter().map(|p| [p[0], p[1]]).collect();
    let mesh = MeshView {
        positions: &positions,
        point_vertices: None,
        faces: &faces,
        normals: Some(&positions),
        colors: None,
        materials: None,
        texture_coordinates: Some(&uv),
    };
    encode(
        &mesh,
        &EncodeOptions {
            speed,
            ..EncodeOptions::default()
        },
    )
    .unwrap()
}

/// Marsaglia's xorshift64: enough to place mutations, and the same in every run.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    fn below(&mut self, bound: usize) -> usize {
        (self.next() % bound as u64) as usize
    }
}

fn mutate(bytes: &mut Vec<u8>, random: &mut Random) {
    for _ in 0..=random.below(4) {
        // Half of the mutations hit the first bytes, where the counts are.
        let reach = if random.below(2) == 0 {
            bytes.len().min(64)
        } else {
            bytes.len()
        };
        let at = random.below(reach);
        match random.below(5) {
            0 => bytes[at] ^= 1 << random.below(8),
            1 => bytes[at] = 0xff,
            2 => bytes[at] = random.next().to_le_bytes()[0],
            3 => bytes.insert(at, 0xff),
            _ if at > 12 => bytes.truncate(at),
            _ => bytes[at] = bytes[at].wrapping_add(1),
        }
    }
}

#[test]
fn mutated_files_neither_crash_nor_exceed_the_memory_limit() {
    let rounds: usize =
        std::env::var("STEADYMESH_FUZZ_ROUNDS").map_or(1_000, |text| text.parse().unwrap());
    let seed = std::env::var("STEADYMESH_FUZZ_SEED").map_or(1, |text| text.parse().unwrap());
    let mut random = Random(seed);
    let mut refused = 0;
    for (n, speed) in [(5, 0), (5, 3), (12, 5), (12, 7), (5, 10)] {
        let valid = doughnut(n, speed);
        for _ in 0..rounds {
            let mut bytes = valid.clone();
            mutate(&mut bytes, &mut random);
            refused += usize::from(decode(&bytes, &ANY_COUNT).is_err());
            // The allocator's rounding comes on top of what is asked for.
            assert!(last_decode_peak_bytes() <= MEMORY + 4096, "{bytes:?}");
        }
    }
    assert!(
        refused > rounds,
        "the mutations hardly ever did harm: {refused}"
    );
}

/// Seven bits a byte, least significant first.
fn varint(mut value: u32) -> Vec<u8> {
    let mut bytes = Vec::new();
    while value >= 0x80 {
        bytes.push(value.to_le_bytes()[0] | 0x80);
        value >>= 7;
    }
    bytes.push(value.to_le_bytes()[0]);
    bytes
}

/// About 60 bytes of a mesh whose connectivity is coded by `method` (0 sequential,
/// 1 EdgeBreaker) and promises these counts.
fn promise(method: u8, vertices: u32, faces: u32) -> Vec<u8> {
    let mut bytes = b"DRACO\x02\x02\x01".to_vec();
    bytes.extend([method, 0, 0]);
    if method == 0 {
        bytes.extend([varint(faces), varint(vertices), vec![1]].concat());
    } else {
        // Standard traversal, counts, no attribute seams, symbols, no splits.
        bytes.push(0);
        bytes.extend([varint(vertices), varint(faces), vec![0], varint(faces)].concat());
    }
    bytes.extend([0; 40]);
    bytes
}

#[test]
fn a_small_file_that_promises_billions_is_refused_by_count() {
    for method in [0, 1] {
        let error = decode(&promise(method, u32::MAX, u32::MAX), &LIMITS).unwrap_err();
        assert!(matches!(
            error,
            DecodeError::LimitExceeded {
                found: 4_294_967_295,
                ..
            }
        ));
    }
}

#[test]
fn a_promise_within_the_count_limits_still_ends_at_the_memory_limit() {
    // If it were believed, the corner table alone would need gigabytes.
    let error = decode(&promise(1, 67_108_864, 178_956_971), &ANY_COUNT).unwrap_err();
    assert_eq!(error, DecodeError::OutOfMemory { limit: MEMORY });
    assert!(last_decode_peak_bytes() <= MEMORY + 4096);
    assert_eq!(
        error.to_string(),
        "decoding the Draco file needs more memory than the limit of 16777216 bytes"
    );
}

#[test]
fn a_valid_file_needs_a_budget_and_says_so_without_one() {
    let bytes = doughnut(12, 5);
    assert!(decode(&bytes, &LIMITS).is_ok());
    let peak = last_decode_peak_bytes();
    assert!(
        (10_000..1 << 20).contains(&peak),
        "the allocator was not replaced: {peak}"
    );
    // Every smaller budget is refused at some other allocation.
    for limit in (0..peak - 4096).step_by(997) {
        let limits = DecodeLimits {
            max_memory_bytes: limit,
            ..LIMITS
        };
        assert_eq!(
            decode(&bytes, &limits),
            Err(DecodeError::OutOfMemory { limit })
        );
    }
}

#[test]
fn every_cut_of_a_valid_file_is_refused_or_decoded() {
    let bytes = doughnut(5, 5);
    for length in 0..bytes.len() {
        let _ = decode(&bytes[..length], &LIMITS);
    }
    assert_eq!(decode(&bytes[..4], &LIMITS), Err(DecodeError::NotDraco));
    assert_eq!(decode(b"", &LIMITS), Err(DecodeError::NotDraco));
    assert!(matches!(
        decode(&bytes[..20], &LIMITS),
        Err(DecodeError::Malformed { .. })
    ));
}

#[test]
fn a_point_cloud_is_refused_with_a_sentence() {
    let mut bytes = doughnut(5, 5);
    bytes[7] = 0;
    let error = decode(&bytes, &LIMITS).unwrap_err();
    assert_eq!(
        error.to_string(),
        "the Draco file holds a point cloud; a mesh with faces is needed"
    );
}

#[test]
fn a_count_deep_inside_a_file_cannot_ask_for_more_than_its_mesh_justifies() {
    let valid = doughnut(12, 3);
    let limits = DecodeLimits {
        max_memory_bytes: 1 << 30,
        ..LIMITS
    };
    let mut is_disproportionate = false;
    for at in 20..valid.len() - 4 {
        let mut bytes = valid.clone();
        bytes[at..at + 4].copy_from_slice(&0x7fff_ffff_u32.to_le_bytes());
        if let Err(error) = decode(&bytes, &limits) {
            is_disproportionate |= error
                .to_string()
                .contains("far too much for its own counts");
        }
        assert!(last_decode_peak_bytes() < 6 << 20);
    }
    assert!(is_disproportionate);
}
