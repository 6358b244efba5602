use nalgebra::Isometry3;

use super::energy::{Correspondence, Problem, Samples, Weights, identity_transforms};
use super::normal_equations::NormalEquations;
use super::system::System;
use super::*;
use crate::metrics::{DistanceStatistics, surface_distances};
use crate::registration::Target;
use crate::{Face, Point, TriangleMesh, Vector};

/// A tube along x from 0 to 10 with a radius of about 1, bent by `bend` radians over its length.
fn tube(rings: u32, segments: u32, bend: f64) -> TriangleMesh {
    let point = |ring: u32, s: u32| {
        let (t, phi) = (
            f64::from(ring) / f64::from(rings),
            std::f64::consts::TAU * f64::from(s) / f64::from(segments),
        );
        let radius = 1.0 + 0.2 * (9.0 * t).sin() + 0.1 * (2.0 * phi).cos();
        let (y, z) = (radius * phi.cos(), radius * phi.sin());
        // Every slice turns about the z axis, further along the tube by more.
        let angle = bend * t * t;
        let turned = nalgebra::Rotation3::from_axis_angle(&Vector::z_axis(), angle);
        Point::from(turned * Vector::new(10.0 * t, y, z))
    };
    let positions = (0..=rings)
        .flat_map(|r| (0..segments).map(move |s| point(r, s)))
        .collect();
    let at = |r: u32, s: u32| r * segments + s % segments;
    let faces: Vec<Face> = (0..rings)
        .flat_map(|r| (0..segments).map(move |s| (r, s)))
        .flat_map(|(r, s)| {
            [
                [at(r, s), at(r, s + 1), at(r + 1, s)],
                [at(r, s + 1), at(r + 1, s + 1), at(r + 1, s)],
            ]
        })
        .collect();
    TriangleMesh::new(positions, faces).unwrap()
}

fn mean_residual(positions: &[Point], target: &Target) -> f64 {
    DistanceStatistics::of(&surface_distances(positions, target.surface())).mean
}

#[test]
fn a_bent_tube_is_followed_by_both_solvers_although_no_vertex_corresponds() {
    let (source, bent) = (tube(80, 40, 0.0), tube(71, 43, 0.15));
    let target = Target::new(&bent).unwrap();
    let before = mean_residual(source.positions(), &target);
    for solver in [Solver::Direct, Solver::Lbfgs] {
        let options = Options {
            solver,
            ..Options::default()
        };
        let found = register(&source, &target, &options).unwrap();
        let after = mean_residual(&found.positions, &target);
        assert!(after < 0.05 * before, "{solver:?}: {before} {after}");
    }
}

/// One round from the same start, the same correspondences and the same weights: what each
/// solver makes of the surrogate, given `max_inner_iterations`.
fn one_round(bend: f64, max_inner_iterations: usize) -> (f64, f64) {
    let (source, bent) = (tube(60, 30, 0.0), tube(53, 31, bend));
    let target = Target::new(&bent).unwrap();
    let graph = DeformationGraph::new(&source, &GraphOptions::default());
    let samples = Samples::new(&graph, &source, 0..source.vertex_count());
    let weights = Weights {
        smoothness: 0.5,
        rotation: 0.05,
    };
    let problem = Problem {
        graph: &graph,
        samples: &samples,
        weights,
    };
    let system = System::new(&graph);
    let start = identity_transforms(graph.nodes().len());
    let targets: Vec<Option<Correspondence>> = source
        .positions()
        .iter()
        .map(|p| {
            let (surface, normal) = target.closest(p);
            Some(Correspondence {
                position: surface.position,
                normal,
            })
        })
        .collect();
    let surrogate = problem.surrogate(
        &start,
        &samples.all_deformed(&start),
        &targets,
        Scales {
            alignment: 0.3,
            smoothness: 0.6,
        },
    );
    let options = Options {
        max_inner_iterations,
        inner_tolerance: 1e-12,
        ..Options::default()
    };
    let factorised = system.factorise(&problem, &surrogate).unwrap();
    let equations = NormalEquations {
        problem: &problem,
        surrogate: &surrogate,
    };
    let value = |transforms| problem.surrogate_value(&surrogate, transforms);
    let direct = direct::minimize(&equations, &factorised, &start, &options).unwrap();
    let lbfgs = lbfgs::minimize(&equations, &factorised, &start, &options).unwrap();
    assert!(value(&direct.transforms) < value(&start));
    (value(&direct.transforms), value(&lbfgs.transforms))
}

#[test]
fn the_direct_solver_never_ends_at_a_higher_energy() {
    for bend in [0.02, 0.1, 0.3] {
        let (direct, lbfgs) = one_round(bend, 200);
        assert!(
            direct <= lbfgs * (1.0 + 1e-9),
            "bend {bend}: {direct} above {lbfgs}"
        );
    }
}

#[test]
fn the_nodes_reach_every_vertex_and_their_weights_add_up_to_one() {
    let mesh = tube(60, 30, 0.1);
    let graph = DeformationGraph::new(&mesh, &GraphOptions::default());
    for vertex in 0..mesh.vertex_count() {
        let sum: f64 = graph.influences(vertex).iter().map(|i| i.weight).sum();
        assert!((sum - 1.0).abs() < 1e-12, "vertex {vertex}: {sum}");
    }
}

#[test]
fn surfaces_that_touch_without_a_common_edge_are_not_coupled() {
    let one = tube(20, 20, 0.0);
    let apart = Isometry3::translation(0.0, 2.2, 0.0);
    let mut positions = one.positions().to_vec();
    positions.extend(one.positions().iter().map(|p| apart * p));
    let offset = one.vertex_count() as u32;
    let mut faces = one.faces().to_vec();
    faces.extend(one.faces().iter().map(|f| f.map(|c| c + offset)));
    let both = TriangleMesh::new(positions, faces).unwrap();
    let graph = DeformationGraph::new(&both, &GraphOptions::default());
    let nodes_of = |range: std::ops::Range<usize>| -> std::collections::BTreeSet<u32> {
        range
            .flat_map(|v| graph.influences(v).iter().map(|i| i.node))
            .collect()
    };
    let (first, second) = (
        nodes_of(0..offset as usize),
        nodes_of(offset as usize..both.vertex_count()),
    );
    assert!(first.is_disjoint(&second));
}

#[test]
fn a_target_out_of_sight_is_an_error_and_not_a_frozen_copy() {
    let source = tube(20, 20, 0.0);
    // Turned inside out: no normal agrees.
    let inside_out = source
        .faces()
        .iter()
        .map(|[a, b, c]| [*a, *c, *b])
        .collect();
    let target = TriangleMesh::new(source.positions().to_vec(), inside_out).unwrap();
    let target = Target::new(&target).unwrap();
    let error = register(&source, &target, &Options::default()).unwrap_err();
    assert!(matches!(
        error,
        crate::registration::RegistrationError::TooFewCorrespondences { .. }
    ));
}

#[test]
fn a_body_of_creases_is_registered_onto_itself() {
    // A double cone: the normals of all its vertices are far off those of their faces.
    let sides = 20u32;
    let at = |s: u32| std::f64::consts::TAU * f64::from(s) / f64::from(sides);
    let rim = (0..sides).map(|s| Point::new(at(s).cos(), at(s).sin(), 0.0));
    let mut positions = vec![Point::new(0.0, 0.0, 0.3), Point::new(0.0, 0.0, -0.3)];
    positions.extend(rim);
    let faces = (0..sides).flat_map(|s| {
        let (a, b) = (2 + s, 2 + (s + 1) % sides);
        [[0, a, b], [1, b, a]]
    });
    let cone = TriangleMesh::new(positions, faces.collect()).unwrap();
    let target = Target::new(&cone).unwrap();
    let found = register(&cone, &target, &Options::default()).unwrap();
    assert_eq!(found.matched_share, 1.0);
    let moved = found.positions.iter().zip(cone.positions());
    let largest = moved.map(|(p, q)| (p - q).norm()).fold(0.0, f64::max);
    assert!(largest < 1e-9, "{largest}");
}

#[test]
fn the_unit_of_length_does_not_change_a_bit() {
    let (source, bent) = (tube(60, 30, 0.0), tube(53, 31, 0.15));
    let registered = |unit: f64| {
        let scaled = |mesh: &TriangleMesh| {
            let positions = mesh.positions().iter().map(|p| p * unit).collect();
            mesh.with_positions(positions).unwrap()
        };
        let target = Target::new(&scaled(&bent)).unwrap();
        let found = register(&scaled(&source), &target, &Options::default()).unwrap();
        found.positions.iter().map(|p| p / unit).collect::<Vec<_>>()
    };
    let reference = registered(1.0);
    for unit in [1.0 / 1024.0, 1024.0] {
        assert_eq!(registered(unit), reference, "unit {unit}");
    }
}
