//! How consistent each tracking mode is where the true motion is known: on the synthetic rig.
//!
//! `cargo run --release --example known_motion -- SPEED NOISE FRAMES VERTICES`
//!
//! Prints averages over the frames after the first, at a tenth of the faces: distances in percent
//! of the diagonal, and what has come back of the previous result, carried along the true motion.
#![allow(clippy::print_stdout, reason = "an example says what it measured")]

use anyhow::Context;
use steadymesh::pipeline::{
    PreparedFrame, RawFrame, Settings, TargetSize, process, process_registered, register,
};
use steadymesh_geometry::metrics::consistency;
use steadymesh_geometry::spatial::TriangleTree;
use steadymesh_geometry::{Point, TriangleMesh};
use steadymesh_proto::metrics::Tracking;
use steadymesh_synthetic_rig::{Frame, Options, Rig};

const MODES: [Tracking; 3] = [Tracking::Off, Tracking::Paper, Tracking::Robust];

fn main() -> anyhow::Result<()> {
    let arguments: Vec<f64> = std::env::args()
        .skip(1)
        .map(|argument| argument.parse())
        .collect::<Result<_, _>>()?;
    let &[speed, noise, frames, vertices] = arguments.as_slice() else {
        anyhow::bail!("wanted: SPEED NOISE FRAMES VERTICES");
    };
    let rig = Rig::new(&Options {
        speed,
        noise,
        vertex_count: vertices as usize,
        ..Options::default()
    })?;
    for mode in MODES {
        let [to_current, reverse, vertices, edges, flicker] = run(&rig, mode, frames as u64)?;
        println!(
            "{mode:?}: k {to_current:.4} reverse {reverse:.4} vertices {vertices:.1} % \
             edges {edges:.1} % flicker {flicker:.4}"
        );
    }
    Ok(())
}

fn run(rig: &Rig, tracking: Tracking, frames: u64) -> anyhow::Result<[f64; 5]> {
    let settings = Settings {
        tracking,
        target: TargetSize::Ratio(0.1),
        ..Settings::default()
    };
    let mut sums = [0.0; 5];
    let mut before = frame(rig, 0)?;
    let mut output = process(&before.1, None, &settings, &mut ())?.mesh;
    for index in 1..frames {
        let next = frame(rig, index)?;
        let registered = register(&before.1, &next.1, &settings.registration)?;
        let out = process_registered(&next.1, Some(registered), Some(&output), &settings, &mut ())?;
        let found = consistency(&carry(rig, &before, &output, index)?, &out.mesh)
            .context("no faces are left")?;
        let share = 100.0 / out.metrics.bbox_diagonal;
        let to_current = out
            .metrics
            .surface_distance
            .context("not measured")?
            .current;
        let reverse = out.metrics.current_to_output.context("not measured")?;
        let figures = [
            to_current.mean * share,
            reverse.mean * share,
            100.0 * found.vertex_persistence,
            100.0 * found.edge_persistence,
            found.flicker * share,
        ];
        for (sum, figure) in sums.iter_mut().zip(figures) {
            *sum += figure / (frames - 1) as f64;
        }
        (before, output) = (next, out.mesh);
    }
    Ok(sums)
}

/// A frame as the rig knows it, and as the pipeline does.
fn frame(rig: &Rig, index: u64) -> anyhow::Result<(Frame, PreparedFrame)> {
    let frame = rig.frame(index);
    let raw = RawFrame {
        positions: frame.positions.iter().map(|p| p.map(f64::from)).collect(),
        faces: frame.faces.clone(),
        byte_count: 0,
    };
    Ok((frame, PreparedFrame::new(raw, &mut ())?))
}

/// The previous frame's result, carried along the true motion to frame `index`.
fn carry(
    rig: &Rig,
    (frame, _): &(Frame, PreparedFrame),
    output: &TriangleMesh,
    index: u64,
) -> anyhow::Result<TriangleMesh> {
    let positions = frame
        .positions
        .iter()
        .map(|p| Point::from(p.map(f64::from)));
    let mesh = TriangleMesh::new(positions.collect(), frame.faces.clone())?;
    let tree = TriangleTree::new(&mesh).context("the frame has no faces")?;
    let rest_of = |point: &Point| {
        let closest = tree.closest(point);
        let [a, b, c] = mesh.triangle(closest.face as usize);
        let (u, v, w) = (b - a, c - a, closest.position - a);
        let normal = u.cross(&v);
        let second = w.cross(&v).dot(&normal) / normal.norm_squared();
        let third = u.cross(&w).dot(&normal) / normal.norm_squared();
        frame.rest_at(closest.face as usize, [1.0 - second - third, second, third])
    };
    let rest: Option<Vec<[f64; 3]>> = output.positions().iter().map(rest_of).collect();
    let points: Vec<[f64; 3]> = output.positions().iter().map(|p| p.coords.into()).collect();
    let rest = rest.context("a face is not the rig's")?;
    let moved = rig.carry(&points, &rest, index - 1, index);
    Ok(output.with_positions(moved.into_iter().map(Point::from).collect())?)
}
