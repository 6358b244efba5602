//! Registration against motions that are known exactly. Connectivity is another in every frame.
//!
//! Figures are in percent of the target's diagonal, of the distance between where registration
//! puts a vertex and where it truly went.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test fails by panicking, and says what it measured"
)]

mod shapes;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use shapes::{Capsule, Meshed, Point, Solid};
use steadymesh_geometry::TriangleMesh;
use steadymesh_geometry::metrics::DistanceStatistics;
use steadymesh_geometry::registration::{Options, Registration, Target, register};
use steadymesh_synthetic_rig as rig;

/// Two frames, and where the vertices of the first truly are in the second.
struct Pair {
    source: TriangleMesh,
    target: TriangleMesh,
    truth: Vec<Point>,
}

#[derive(Clone, Copy)]
struct Figures {
    mean: f64,
    p95: f64,
    max: f64,
}

impl Figures {
    fn of(lengths: &[f64], diagonal: f64) -> Self {
        assert!(!lengths.is_empty());
        let statistics = DistanceStatistics::of(lengths);
        let percent = 100.0 / diagonal;
        Self {
            mean: percent * statistics.mean,
            p95: percent * DistanceStatistics::quantile(lengths, 0.95),
            max: percent * statistics.max,
        }
    }

    fn show(self, what: &str) -> Self {
        println!(
            "{what}: {:.3} / {:.3} / {:.3}",
            self.mean, self.p95, self.max
        );
        self
    }
}

impl Pair {
    fn of_rig(speed: f64, frame: u64) -> Self {
        let options = rig::Options {
            speed,
            vertex_count: 12_000,
            ..rig::Options::default()
        };
        let rig = rig::Rig::new(&options).unwrap();
        let (before, after) = (rig.frame(frame), rig.frame(frame + 1));
        let points: Vec<[f64; 3]> = before.positions.iter().map(|p| p.map(f64::from)).collect();
        let truth = rig.carry(&points, &before.rest, frame, frame + 1);
        let target = after
            .positions
            .iter()
            .map(|p| Point::from(p.map(f64::from)));
        Self {
            source: TriangleMesh::new(points.into_iter().map(Point::from).collect(), before.faces)
                .unwrap(),
            target: TriangleMesh::new(target.collect(), after.faces).unwrap(),
            truth: truth.into_iter().map(Point::from).collect(),
        }
    }

    /// And the part that each vertex of the source is on.
    fn of_solids(before: &Solid, after: &Solid) -> (Self, Vec<usize>) {
        let (source, target) = (before.mesh(0.95, 0.025, 0.1), after.mesh(0.95, 0.025, 0.37));
        let vertices = source.positions.iter().zip(&source.parts);
        let truth = vertices.map(|(p, &part)| before.carry(after, p, part));
        let mesh = |m: &Meshed| TriangleMesh::new(m.positions.clone(), m.faces.clone()).unwrap();
        let pair = Self {
            truth: truth.collect(),
            source: mesh(&source),
            target: mesh(&target),
        };
        (pair, source.parts)
    }

    fn diagonal(&self) -> f64 {
        self.target.bounding_box().diagonal()
    }

    fn registered(&self) -> Registration {
        let target = Target::new(&self.target).unwrap();
        register(&self.source, &target, &Options::default()).unwrap()
    }

    /// The error of the vertices that `of` picks.
    fn errors(&self, found: &Registration, of: impl Fn(usize) -> bool) -> Figures {
        let picked = (0..self.truth.len()).filter(|&v| of(v));
        let lengths: Vec<f64> = picked
            .map(|v| (found.positions[v] - self.truth[v]).norm())
            .collect();
        Figures::of(&lengths, self.diagonal())
    }

    /// How far a vertex truly moves.
    fn motion(&self, vertex: usize) -> f64 {
        (self.truth[vertex] - self.source.positions()[vertex]).norm()
    }

    /// Patches as wide as a hand are cut out of the target until a tenth of it is gone; returns
    /// where they were.
    fn cut_holes(&mut self) -> impl Fn(&Point) -> bool + use<> {
        const RADIUS: f64 = 0.035;
        let mut centers: Vec<Point> = Vec::new();
        let mut faces = self.target.faces().to_vec();
        let enough = faces.len() - faces.len() / 10;
        let count = self.target.vertex_count();
        for hole in 1.. {
            if faces.len() <= enough {
                break;
            }
            // The golden ratio spreads them.
            let share = (0.618_034 * f64::from(hole)).fract();
            let center = self.target.positions()[(share * count as f64) as usize];
            faces.retain(|f| RADIUS < (self.target.positions()[f[0] as usize] - center).norm());
            centers.push(center);
        }
        self.target = TriangleMesh::new(self.target.positions().to_vec(), faces).unwrap();
        move |p| centers.iter().any(|center| (p - center).norm() <= RADIUS)
    }
}

#[test]
fn the_true_motion_of_a_figure_is_found_at_any_speed() {
    for (speed, mean, p95) in [
        (0.5, 0.05, 0.2),
        (1.0, 0.08, 0.3),
        (2.0, 0.1, 0.4),
        (3.0, 0.15, 0.6),
    ] {
        let pair = Pair::of_rig(speed, 7);
        let found = pair.registered();
        let error = pair
            .errors(&found, |_| true)
            .show(&format!("speed {speed}"));
        assert!(error.mean < mean && error.p95 < p95, "speed {speed}");
    }
}

#[test]
fn a_limb_that_moves_three_percent_of_the_diagonal_is_followed() {
    let pair = Pair::of_rig(2.0, 7);
    let found = pair.registered();
    let far = |v: usize| 0.03 * pair.diagonal() <= pair.motion(v);
    let error = pair.errors(&found, far).show("figure");
    assert!(error.mean < 0.3 && error.p95 < 0.6);
    for turn in [0.13, -0.13] {
        let (pair, parts) = Pair::of_solids(&swung(0.0), &swung(turn));
        let found = pair.registered();
        let furthest = (0..parts.len()).map(|v| pair.motion(v)).fold(0.0, f64::max);
        assert!(0.03 * pair.diagonal() < furthest);
        let arm = pair.errors(&found, |v| parts[v] == 1).show("arm");
        let body = pair.errors(&found, |v| parts[v] == 0).show("body");
        assert!(arm.mean < 0.5 && body.mean < 0.1);
        let residual = Figures::of(&found.residuals(), pair.diagonal()).show("residual");
        assert!(residual.mean < 0.03);
    }
}

#[test]
fn holes_drag_nothing_to_their_rims_and_leave_the_rest_as_it_is() {
    for speed in [1.0, 2.0] {
        let mut pair = Pair::of_rig(speed, 7);
        let whole = pair.registered();
        let in_hole = pair.cut_holes();
        let holed = pair.registered();
        let over = |v: usize| in_hole(&pair.truth[v]);
        let rest = [&whole, &holed].map(|f| pair.errors(f, |v| !over(v)).show("rest"));
        assert!(rest[1].mean < 1.25 * rest[0].mean, "speed {speed}");
        let over_holes = [&whole, &holed].map(|f| pair.errors(f, over).show("over"));
        assert!(
            over_holes[1].mean < 1.25 * over_holes[0].mean && over_holes[1].p95 < 0.4,
            "speed {speed}"
        );
    }
}

#[test]
fn parts_that_touch_and_part_do_not_pull_on_each_other() {
    for (from, to) in [(-0.01, 0.04), (0.04, -0.01)] {
        let (pair, parts) = Pair::of_solids(&hands(from), &hands(to));
        let found = pair.registered();
        let named = [
            "body",
            "left palm",
            "left thumb",
            "right palm",
            "right thumb",
        ];
        for (part, name) in named.into_iter().enumerate() {
            // Where the hands are one surface nothing says which of them a vertex is on.
            let apart = |v: usize| 0.05 < pair.source.positions()[v].x.abs() || part == 0;
            let error = pair
                .errors(&found, |v| parts[v] == part && apart(v))
                .show(name);
            let bound = if part == 0 { 0.1 } else { 0.35 };
            assert!(error.mean < bound, "{name} from {from} to {to}");
        }
    }
}

const BODY: Capsule = Capsule {
    ends: [Point::new(0.0, -0.6, 0.0), Point::new(0.0, 0.6, 0.0)],
    radius: 0.22,
};

/// A body before which two upright hands are `gap` apart.
fn hands(gap: f64) -> Solid {
    let hand = |side: f64| {
        let palm = Capsule {
            ends: [Point::new(0.0, -0.05, 0.4), Point::new(0.0, 0.25, 0.4)],
            radius: 0.09,
        };
        // Without it nothing would say how the palm has turned.
        let thumb = Capsule {
            ends: [
                Point::new(0.0, 0.1, 0.4),
                Point::new(side * 0.2, 0.15, 0.45),
            ],
            radius: 0.05,
        };
        let away = Isometry3::translation(side * (0.09 + gap / 2.0), 0.0, 0.0);
        [(palm, away), (thumb, away)]
    };
    let body = [(BODY, Isometry3::identity())];
    Solid {
        parts: [&body[..], &hand(1.0), &hand(-1.0)].concat(),
    }
}

/// A body with an arm that has turned about its shoulder.
fn swung(angle: f64) -> Solid {
    let shoulder = Vector3::new(0.22, 0.45, 0.0);
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle);
    let about = Translation3::from(shoulder) * turn * Translation3::from(-shoulder);
    let arm = Capsule {
        ends: [Point::from(shoulder), Point::new(0.7, 0.25, 0.28)],
        radius: 0.08,
    };
    Solid {
        parts: vec![(BODY, Isometry3::identity()), (arm, about)],
    }
}
