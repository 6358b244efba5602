//! What a user of the rig relies on: closed manifolds, the asked-for number of
//! vertices, reproducible bits and a motion that is known.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test fails by panicking, and says what it measured"
)]

use std::collections::BTreeMap;

use steadymesh_synthetic_rig::{Frame, Options, OptionsError, Rig};

fn rig(vertex_count: usize) -> Rig {
    Rig::new(&Options {
        vertex_count,
        ..Options::default()
    })
    .expect("the options are in range")
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3)
        .map(|axis| (a[axis] - b[axis]).powi(2))
        .sum::<f64>()
        .sqrt()
}

fn positions(frame: &Frame) -> Vec<[f64; 3]> {
    frame
        .positions
        .iter()
        .map(|position| position.map(f64::from))
        .collect()
}

fn root_mean_square(distances: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = distances.len() as f64;
    (distances.map(|d| d * d).sum::<f64>() / count).sqrt()
}

/// Panics unless every edge has one face on either side, in opposite directions,
/// and the faces around every vertex form one fan.
fn assert_closed_manifold(frame: &Frame) {
    let mut next_around = BTreeMap::new();
    for &[a, b, c] in &frame.faces {
        for (vertex, from, to) in [(a, b, c), (b, c, a), (c, a, b)] {
            let previous = next_around.insert((vertex, from), to);
            assert_eq!(
                previous, None,
                "two faces on the same side of edge {vertex}-{from}"
            );
        }
    }
    let mut degrees = vec![0_usize; frame.positions.len()];
    for &(vertex, to) in next_around.keys() {
        assert!(
            next_around.contains_key(&(to, vertex)),
            "edge {vertex}-{to} is open"
        );
        degrees[vertex as usize] += 1;
    }
    for (vertex, &degree) in (0_u32..).zip(&degrees) {
        let ((_, first), _) = next_around
            .range((vertex, 0)..)
            .next()
            .expect("a used vertex");
        let mut steps = 1;
        let mut neighbor = next_around[&(vertex, *first)];
        while neighbor != *first {
            neighbor = next_around[&(vertex, neighbor)];
            steps += 1;
        }
        assert_eq!(
            steps, degree,
            "the faces around vertex {vertex} form several fans"
        );
    }
}

/// Six times the signed volume: positive if the faces look outwards.
fn signed_volume(frame: &Frame) -> f64 {
    let positions = positions(frame);
    let determinant = |face: &[u32; 3]| {
        let [a, b, c] = face.map(|vertex| positions[vertex as usize]);
        a[0] * (b[1] * c[2] - b[2] * c[1])
            + a[1] * (b[2] * c[0] - b[0] * c[2])
            + a[2] * (b[0] * c[1] - b[1] * c[0])
    };
    frame.faces.iter().map(determinant).sum::<f64>() / 6.0
}

/// Twice the root of three times area over the sum of squared edges: 1 if equilateral, 0 if flat.
fn shape_quality(corners: [[f64; 3]; 3]) -> f64 {
    let [a, b, c] = corners;
    let (ab, bc, ca) = (distance(a, b), distance(b, c), distance(c, a));
    let half = (ab + bc + ca) / 2.0;
    let area = (half * (half - ab) * (half - bc) * (half - ca))
        .max(0.0)
        .sqrt();
    4.0 * 3.0_f64.sqrt() * area / (ab * ab + bc * bc + ca * ca)
}

#[test]
fn every_frame_is_a_closed_outward_manifold_of_a_human_volume() {
    let rig = rig(20_000);
    for index in 0..40 {
        let frame = rig.frame(index);
        assert_closed_manifold(&frame);
        // An adult of 1.8 m displaces 0.06 to 0.1 m³; this one is dressed.
        let volume = signed_volume(&frame);
        assert!((0.06..0.12).contains(&volume), "{volume}");
    }
}

#[test]
fn features_thinner_than_the_grid_leave_the_mesh_a_manifold() {
    for seed in 0..3 {
        let options = Options {
            vertex_count: 1_000,
            seed,
            ..Options::default()
        };
        let rig = Rig::new(&options).unwrap();
        for index in 0..150 {
            assert_closed_manifold(&rig.frame(index));
        }
    }
}

#[test]
fn the_vertex_count_is_met_within_five_percent() {
    for (target, frames) in [
        (1_000, 60),
        (3_000, 40),
        (20_000, 20),
        (100_000, 3),
        (500_000, 1),
    ] {
        let rig = rig(target);
        for index in 0..frames {
            let frame = rig.frame(index);
            let ratio = frame.positions.len() as f64 / target as f64;
            assert!(
                (0.95..=1.05).contains(&ratio),
                "{target} vertices, frame {index}: {ratio}"
            );
            assert_eq!(frame.rest.len(), frame.positions.len());
        }
    }
}

#[test]
fn triangles_are_well_shaped_but_for_a_few_in_creases() {
    let rig = rig(20_000);
    for index in 0..5 {
        let frame = rig.frame(index);
        let positions = positions(&frame);
        let corners = |face: &[u32; 3]| face.map(|vertex| positions[vertex as usize]);
        let qualities: Vec<f64> = frame
            .faces
            .iter()
            .map(|face| shape_quality(corners(face)))
            .collect();
        let count = qualities.len() as f64;
        let mean = qualities.iter().sum::<f64>() / count;
        let thin = qualities.iter().filter(|&&quality| quality < 0.3).count() as f64;
        assert!(mean > 0.8, "{mean}");
        assert!(thin / count < 0.005, "{thin} of {count}");
        assert!(qualities.iter().all(|&quality| quality > 1e-4));
    }
}

#[test]
fn the_same_options_and_index_give_the_same_bits() {
    let frame = rig(5_000).frame(17);
    assert_eq!(frame, rig(5_000).frame(17));
}

#[test]
fn connectivity_differs_between_frames_loops_and_seeds() {
    let rig = rig(5_000);
    let other = Rig::new(&Options {
        vertex_count: 5_000,
        seed: 2,
        ..Options::default()
    })
    .unwrap();
    let first = rig.frame(0).faces;
    assert_ne!(first, rig.frame(1).faces);
    assert_ne!(first, rig.frame(rig.period_frames()).faces);
    assert_ne!(first, other.frame(0).faces);
}

#[test]
fn positions_are_the_moved_material_points_up_to_the_noise() {
    for noise in [0.0, 0.0003, 0.002] {
        let rig = Rig::new(&Options {
            noise,
            ..Options::default()
        })
        .unwrap();
        for index in [0, 31, 1_000_003] {
            let frame = rig.frame(index);
            let exact = rig.move_to(&frame.rest, index);
            let errors = positions(&frame)
                .into_iter()
                .zip(exact)
                .map(|(p, q)| distance(p, q));
            // Rounding to single precision moves a coordinate of 2 m by at most 1.2e-7 m; the
            // sample deviation of 20,000 normal deviates is within 3 % of theirs.
            let measured = root_mean_square(errors);
            assert!(
                (measured - noise).abs() < 0.03 * noise + 3e-7,
                "{measured} for {noise}"
            );
        }
    }
}

#[test]
fn the_figure_moves_by_a_plausible_share_of_its_size_from_frame_to_frame() {
    let rig = rig(5_000);
    let rest = rig.frame(0).rest;
    for index in 0..rig.period_frames() {
        let (from, to) = (rig.move_to(&rest, index), rig.move_to(&rest, index + 1));
        let extent = |axis: usize| {
            let values = from.iter().map(|point| point[axis]);
            values.clone().fold(f64::MIN, f64::max) - values.fold(f64::MAX, f64::min)
        };
        let diagonal = distance([extent(0), extent(1), extent(2)], [0.0; 3]);
        let motions: Vec<f64> = from
            .iter()
            .zip(&to)
            .map(|(&p, &q)| distance(p, q))
            .collect();
        let mean = motions.iter().sum::<f64>() / motions.len() as f64 / diagonal;
        let greatest = motions.iter().copied().fold(0.0, f64::max) / diagonal;
        assert!((0.001..0.01).contains(&mean), "frame {index}: {mean}");
        assert!(greatest < 0.05, "frame {index}: {greatest}");
    }
}

#[test]
fn the_pose_repeats_after_the_period_and_not_before() {
    let rig = rig(1_000);
    assert_eq!(rig.period_frames(), 120);
    let rest = rig.frame(0).rest;
    assert_eq!(rig.move_to(&rest, 7), rig.move_to(&rest, 127));
    for divisor in [2, 3, 4, 5] {
        assert_ne!(rig.move_to(&rest, 7), rig.move_to(&rest, 7 + 120 / divisor));
    }
}

#[test]
fn speed_scales_the_motion_and_zero_stands_still() {
    let at_speed = |speed| {
        Rig::new(&Options {
            vertex_count: 1_000,
            speed,
            ..Options::default()
        })
        .expect("the options are in range")
    };
    let (natural, double, still) = (at_speed(1.0), at_speed(2.0), at_speed(0.0));
    let rest = natural.frame(0).rest;
    assert_eq!(double.period_frames(), 60);
    assert_eq!(natural.move_to(&rest, 22), double.move_to(&rest, 11));
    assert_eq!(still.period_frames(), 1);
    assert_eq!(still.move_to(&rest, 0), still.move_to(&rest, 5));
}

#[test]
fn carried_points_follow_the_material_point_and_keep_their_distance_from_it() {
    let rig = rig(20_000);
    let frame = rig.frame(3);
    let (from, to) = (3, 9);
    let carried = rig.carry(&positions(&frame), &frame.rest, from, to);
    let exact = rig.move_to(&frame.rest, to);
    let errors = carried.iter().zip(&exact).map(|(&p, &q)| distance(p, q));
    // The noise of 0.3 mm stays where it was on the body, stretched a little at the joints.
    let measured = root_mean_square(errors);
    assert!((0.00027..0.00033).contains(&measured), "{measured}");
}

#[test]
fn the_middle_of_a_face_is_carried_close_to_the_middle_of_its_carried_corners() {
    let rig = Rig::new(&Options {
        noise: 0.0,
        ..Options::default()
    })
    .unwrap();
    let frame = rig.frame(3);
    let third = [1.0 / 3.0; 3];
    let rest: Vec<[f64; 3]> = (0..frame.faces.len())
        .map(|face| frame.rest_at(face, third).unwrap())
        .collect();
    let middles = |points: &[[f64; 3]]| -> Vec<[f64; 3]> {
        let middle = |face: &[u32; 3]| {
            let corners = face.map(|vertex| points[vertex as usize]);
            [0, 1, 2].map(|axis| corners.iter().map(|corner| corner[axis]).sum::<f64>() / 3.0)
        };
        frame.faces.iter().map(middle).collect()
    };
    let carried = rig.carry(&middles(&positions(&frame)), &rest, 3, 4);
    let expected = middles(&rig.move_to(&frame.rest, 4));
    let errors = carried
        .into_iter()
        .zip(expected)
        .map(|(p, q)| distance(p, q));
    // What the bend of the motion over a face of 1 cm allows; the motion itself is about 5 mm.
    assert!(root_mean_square(errors) < 2e-5);
    assert_eq!(frame.rest_at(frame.faces.len(), third), None);
}

#[test]
fn options_out_of_range_are_refused_by_name() {
    let default = Options::default;
    let refused = |options: Options| Rig::new(&options).unwrap_err();
    let few = refused(Options {
        vertex_count: 999,
        ..default()
    });
    assert_eq!(few, OptionsError::VertexCount(999));
    let stopped = refused(Options {
        frames_per_second: 0.0,
        ..default()
    });
    assert_eq!(stopped, OptionsError::FramesPerSecond(0.0));
    assert_eq!(
        refused(Options {
            speed: -1.0,
            ..default()
        }),
        OptionsError::Speed(-1.0)
    );
    let nan = refused(Options {
        noise: f64::NAN,
        ..default()
    });
    assert!(matches!(nan, OptionsError::Noise(noise) if noise.is_nan()));
}
