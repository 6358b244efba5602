use steadymesh_proto::metrics::Tracking;
use steadymesh_synthetic_rig as rig;

use super::*;

fn frames(count: u64) -> Vec<PreparedFrame> {
    let options = rig::Options {
        vertex_count: 3000,
        ..rig::Options::default()
    };
    rig_frames(&options, count)
}

fn rig_frames(options: &rig::Options, count: u64) -> Vec<PreparedFrame> {
    let rig = rig::Rig::new(options).unwrap();
    (0..count)
        .map(|index| {
            let frame = rig.frame(index);
            let positions = frame.positions.iter().map(|p| p.map(f64::from)).collect();
            let raw = RawFrame {
                positions,
                faces: frame.faces,
                ..RawFrame::default()
            };
            PreparedFrame::new(raw, &mut ()).unwrap()
        })
        .collect()
}

fn settings(tracking: Tracking) -> Settings {
    Settings {
        target: TargetSize::Faces(600),
        tracking,
        ..Settings::default()
    }
}

fn after(frame: &PreparedFrame) -> Previous<'_> {
    Previous {
        frame,
        output: None,
    }
}

#[test]
fn robust_tracking_brings_vertices_back_and_a_scene_cut_resets_it() {
    let frames = frames(2);
    let process_with = |tracking, current: &PreparedFrame, output: &Output| {
        let previous = Previous {
            frame: &frames[0],
            output: Some(output),
        };
        process(current, Some(previous), &settings(tracking), &mut ()).unwrap()
    };
    let first = process(&frames[0], None, &settings(Tracking::Robust), &mut ()).unwrap();
    assert_eq!(first.metrics.tracking, Tracking::Off);
    let persistence = |tracking| {
        let out = process_with(tracking, &frames[1], &first.output);
        assert_eq!(out.metrics.tracking, tracking);
        out.metrics.consistency.unwrap().vertex_persistence
    };
    let (paper, robust) = (persistence(Tracking::Paper), persistence(Tracking::Robust));
    assert!(1.2 * paper < robust, "{paper} {robust}");

    let positions = frames[1].mesh().positions().iter();
    let raw = RawFrame {
        positions: positions
            .map(|p| [p.z * p.z, 0.1 * p.x, p.y * p.x])
            .collect(),
        faces: frames[1].mesh().faces().to_vec(),
        ..RawFrame::default()
    };
    let another = PreparedFrame::new(raw, &mut ()).unwrap();
    for tracking in [Tracking::Off, Tracking::Paper, Tracking::Robust] {
        let cut = process_with(tracking, &another, &first.output);
        let alone = process(&another, None, &settings(tracking), &mut ()).unwrap();
        assert_eq!(cut.draco, alone.draco);
        assert_eq!(cut.metrics.tracking, Tracking::Off);
        assert!(cut.metrics.reset.unwrap().contains("scene cut"));
        assert!(cut.registered.is_none());
    }
}

#[test]
fn a_figure_that_jumps_or_is_noisy_is_still_the_same_scene() {
    let jump = nalgebra::Isometry3::rotation(nalgebra::Vector3::y() * 20f64.to_radians());
    let frames = frames(2);
    let positions = frames[1].mesh().positions().iter();
    let raw = RawFrame {
        positions: positions
            .map(|p| (jump * p).coords.into())
            .map(|[x, y, z]: [f64; 3]| [x + 0.2, y, z])
            .collect(),
        faces: frames[1].mesh().faces().to_vec(),
        ..RawFrame::default()
    };
    let jumped = PreparedFrame::new(raw, &mut ()).unwrap();
    let noisy = rig_frames(
        &rig::Options {
            noise: 0.02,
            ..rig::Options::default()
        },
        2,
    );
    for (before, after) in [(&frames[0], &jumped), (&noisy[0], &noisy[1])] {
        let registered = register(before, after, &Settings::default().registration).unwrap();
        assert_eq!(registered.scene_cut(), None);
    }
}

#[test]
fn a_frame_that_shrank_to_a_part_of_it_is_another_scene() {
    let frames = frames(2);
    let mesh = frames[1].mesh();
    let is_low = |face: &&[u32; 3]| mesh.positions()[face[0] as usize].y < 0.9;
    let raw = RawFrame {
        positions: mesh.positions().iter().map(|p| p.coords.into()).collect(),
        faces: mesh.faces().iter().filter(is_low).copied().collect(),
        ..RawFrame::default()
    };
    let half = PreparedFrame::new(raw, &mut ()).unwrap();
    let options = Settings::default().registration;
    let cut = register(&half, &frames[1], &options).unwrap().scene_cut();
    assert!(0.4 < cut.unwrap().of_current, "{cut:?}");
    let cut = register(&frames[0], &half, &options).unwrap().scene_cut();
    assert!(0.12 < cut.unwrap().of_previous, "{cut:?}");
}

#[test]
fn a_strength_that_is_no_share_is_refused_by_its_range() {
    for found in [-0.01, 1.01, f64::NAN, f64::INFINITY] {
        let error = TrackingStrength::new(found).unwrap_err().to_string();
        assert!(error.contains("from 0 to 1"), "{error}");
    }
    assert_eq!(TrackingStrength::new(1.0).unwrap().get(), 1.0);
}

#[test]
fn without_a_use_for_it_the_previous_frame_is_not_registered() {
    use steadymesh_proto::stream::MetricsMode;
    let frames = frames(2);
    for (metrics, registers) in [
        (MetricsMode::Full, true),
        (MetricsMode::Sampled, false),
        (MetricsMode::Off, false),
    ] {
        let settings = Settings {
            metrics,
            ..settings(Tracking::Off)
        };
        let out = process(&frames[1], Some(after(&frames[0])), &settings, &mut ()).unwrap();
        assert_eq!(out.metrics.registration.is_some(), registers);
    }
}

#[test]
fn a_first_frame_has_no_reference_and_the_asked_number_of_faces() {
    let frames = frames(1);
    let out = process(&frames[0], None, &settings(Tracking::Paper), &mut ()).unwrap();
    assert_eq!(out.output.mesh.face_count(), 600);
    assert_eq!(out.metrics.tracking, Tracking::Off);
    assert!(out.registered.is_none());
    assert!(out.metrics.surface_distance.unwrap().previous.is_none());
}

#[test]
fn tracking_brings_the_result_closer_to_the_registered_previous_frame() {
    let frames = frames(2);
    let paper = process(
        &frames[1],
        Some(after(&frames[0])),
        &settings(Tracking::Paper),
        &mut (),
    )
    .unwrap();
    let to_previous = |out: &ProcessedFrame| {
        let distances = out.metrics.surface_distance.clone().unwrap();
        distances.previous.unwrap().mean
    };
    let options = steadymesh_geometry::registration::Options::default();
    let registered = register(&frames[0], &frames[1], &options).unwrap();
    assert_eq!(paper.registered.as_ref(), Some(&registered.mesh));
    let off = process_registered(
        &frames[1],
        Some(registered),
        None,
        &settings(Tracking::Off),
        &mut (),
    )
    .unwrap();
    let (tracked, untracked) = (to_previous(&paper), to_previous(&off));
    assert!(tracked < untracked, "{tracked} {untracked}");
}

#[test]
fn a_registered_frame_takes_no_part_without_tracking() {
    let frames = frames(2);
    let options = steadymesh_geometry::registration::Options::default();
    let registered = register(&frames[0], &frames[1], &options).unwrap();
    let off = settings(Tracking::Off);
    let alone = process(&frames[1], None, &off, &mut ()).unwrap();
    let measured = process_registered(&frames[1], Some(registered), None, &off, &mut ()).unwrap();
    assert_eq!(alone.draco, measured.draco);
    assert_eq!(measured.metrics.tracking, Tracking::Off);
}

#[test]
fn equal_inputs_give_equal_bytes() {
    let frames = frames(2);
    let run = || {
        process(
            &frames[1],
            Some(after(&frames[0])),
            &settings(Tracking::Paper),
            &mut (),
        )
        .unwrap()
        .draco
    };
    assert_eq!(run(), run());
}

#[test]
fn every_stage_is_reported_once_and_in_order() {
    struct Record(Vec<Stage>);
    impl StageObserver for Record {
        fn ended(&mut self, stage: Stage) {
            self.0.push(stage);
        }
    }
    let mut record = Record(vec![]);
    process(&frames(1)[0], None, &settings(Tracking::Off), &mut record).unwrap();
    assert_eq!(
        record.0,
        [
            Stage::Register,
            Stage::Simplify,
            Stage::Encode,
            Stage::Measure
        ]
    );
}

#[test]
fn a_single_triangle_is_refused_with_the_reason() {
    let raw = RawFrame {
        positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
        faces: vec![[0, 1, 2]],
        ..RawFrame::default()
    };
    let error = PreparedFrame::new(raw, &mut ()).unwrap_err();
    assert_eq!(
        error,
        UnusableFrame::TooFewFaces {
            faces: 1,
            received: 1
        }
    );
}

#[test]
fn a_huge_target_is_refused_by_its_limit() {
    let error = TargetSize::Faces(usize::MAX).check(4_000_000).unwrap_err();
    assert_eq!(
        error,
        InvalidSettings::TargetFaces {
            found: usize::MAX,
            limit: 4_000_000
        }
    );
    assert!(TargetSize::Ratio(f64::NAN).check(4_000_000).is_err());
    assert!(TargetSize::Faces(4000).check(4_000_000).is_ok());
}
