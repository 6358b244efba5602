//! Anchors: the vertices of the previous result, carried along, that the new one should keep.
//!
//! An anchor is attached to the nearest vertex of the mesh. It pulls what that vertex becomes
//! towards where the previous result had a vertex, and merging two anchors costs more than
//! merging anything else. Both fade where the previous frame was registered badly.

use crate::mesh::{Edge, face_normal};
use crate::registration::{Carried, welsch_weight};
use crate::spatial::TriangleTree;
use crate::{Face, Point, Vector};

use super::Quadric;
use super::edge_costs::{NO_PULL, SeenPull, SeenPulls, SeenQuadric};
use super::normalization::Normalization;
use super::placement::place;
use super::refinement::{self, Kept};

/// How strongly the previous result holds the new one.
///
/// Distances are in mean edges of the mesh, weights relative to the planes of the faces that become
/// one. Tuned on human captures at a tenth of their faces.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Weight of the pull along the surface.
    pub weight: f64,
    /// Weight of the pull towards the surface.
    pub normal_weight: f64,
    /// Merging two anchors that fit perfectly costs 1 + this times as much.
    pub merge_penalty: f64,
    /// The share of the pull that is left far from the current surface, as far as the anchor fits, 0 to 1.
    pub far_pull: f64,
    /// The distance between the registered and the current surface at which an anchor's pull has
    /// fallen by 0.4 of what it may fall by.
    pub pull_scale: f64,
    /// The distance at which the whole anchor's weight, its penalty included, has fallen to 0.6:
    /// an anchor may be unfit to say where exactly a vertex belongs and still say that one does.
    pub residual_scale: f64,
    /// The angle between the normals of the two surfaces, in degrees, for which that holds too.
    pub angle_scale_degrees: f64,
    /// What is done after edges were collapsed.
    pub refinement: refinement::Options,
}

impl Options {
    /// The usual options, holding on more or less: 0 is not at all, 0.5 the default, 1 as
    /// strongly as is of use. What holds the new result grows with the square.
    #[must_use]
    pub fn with_strength(strength: f64) -> Self {
        let factor = (2.0 * strength).powi(2);
        let usual = Self::default();
        Self {
            weight: factor * usual.weight,
            normal_weight: factor * usual.normal_weight,
            merge_penalty: factor * usual.merge_penalty,
            refinement: refinement::Options {
                flip_tolerance: factor * usual.refinement.flip_tolerance,
                anchor_hold: factor * usual.refinement.anchor_hold,
                ..usual.refinement
            },
            ..usual
        }
    }
}

impl Default for Options {
    fn default() -> Self {
        Self {
            weight: 0.2,
            normal_weight: 0.4,
            merge_penalty: 2.0,
            pull_scale: 0.05,
            far_pull: 0.3,
            residual_scale: 0.3,
            angle_scale_degrees: 30.0,
            refinement: refinement::Options::default(),
        }
    }
}

/// The anchors of a mesh, at most one a vertex.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Anchors {
    /// By vertex, ascending.
    anchors: Vec<Anchor>,
    /// Those of the previous result.
    pub(super) previous_faces: Vec<Face>,
    merge_penalty: f64,
    pub(super) refinement: refinement::Options,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Anchor {
    vertex: u32,
    /// The one of the previous result that was carried here.
    previous_vertex: u32,
    position: Point,
    /// The face of the mesh on which that is.
    face: u32,
    /// How well it fits, above 0 and at most 1.
    fit: f64,
    /// The weight of its pull in all directions.
    weight: f64,
    /// What the weight towards the surface is above that; may be below 0.
    plane_weight: f64,
    /// The surface's, of unit length; zero if it has none.
    normal: Vector,
}

/// How close, in mean edges, a foot is to the face that it is straight above for that to count without
/// a look at the rest.
const NEAR: f64 = 0.3;

/// Anchors that fit less are left out.
const MIN_FIT: f64 = 0.01;

impl Anchors {
    /// Anchors the mesh of `surface` to what was carried onto it: the vertices of the previous result, between
    /// which `previous_faces` are.
    ///
    /// Of several anchors for the same vertex the fittest stays.
    #[must_use]
    pub fn new(
        (carried, previous_faces): (&[Carried], &[Face]),
        surface: &TriangleTree,
        options: &Options,
    ) -> Self {
        let attach = |(vertex, carried): (usize, &Carried)| {
            attach((vertex as u32, carried), surface, options)
        };
        let mut anchors: Vec<Anchor> = carried.iter().enumerate().filter_map(attach).collect();
        anchors.sort_by(|a, b| a.vertex.cmp(&b.vertex).then(b.fit.total_cmp(&a.fit)));
        anchors.dedup_by_key(|anchor| anchor.vertex);
        Self {
            anchors,
            previous_faces: previous_faces.to_vec(),
            merge_penalty: options.merge_penalty,
            refinement: options.refinement.clone(),
        }
    }
}

/// The anchor that a carried vertex makes: where its foot meets the current surface.
fn attach(
    (previous_vertex, carried): (u32, &Carried),
    surface: &TriangleTree,
    options: &Options,
) -> Option<Anchor> {
    let (mesh, mean_edge) = (surface.mesh(), surface.mesh().mean_edge());
    let closest = surface.below_or_closest(&carried.foot, carried.near, NEAR * mean_edge);
    let corners = mesh.triangle(closest.face as usize);
    let normal = face_normal(corners).unwrap_or_default();
    let angle = carried.normal.dot(&normal).clamp(-1.0, 1.0).acos();
    let fit = welsch_weight(closest.distance, options.residual_scale * mean_edge)
        * welsch_weight(angle, options.angle_scale_degrees.to_radians());
    let near = welsch_weight(closest.distance, options.pull_scale * mean_edge);
    let pull = fit * (options.far_pull + (1.0 - options.far_pull) * near);
    let square = |corner: usize| (corners[corner] - closest.position).norm_squared();
    let nearest = (0..3).min_by(|&i, &j| square(i).total_cmp(&square(j)))?;
    // Not so for a fit that is not a number, as where the mesh has no size.
    (MIN_FIT <= fit).then(|| Anchor {
        previous_vertex,
        vertex: mesh.faces()[closest.face as usize][nearest],
        position: closest.position,
        face: closest.face,
        fit,
        weight: pull * options.weight,
        plane_weight: pull * (options.normal_weight - options.weight),
        normal,
    })
}

/// The anchors as the simplification goes on.
pub(super) struct Pulls {
    /// By vertex, the number of its pull or [`NO_PULL`]: few have one, and edges ask for that often.
    of_vertices: Vec<u32>,
    pulls: Vec<Pull>,
    /// The same as edges are ranked by.
    seen: Vec<SeenPull>,
    merge_penalty: f64,
}

#[derive(Clone, Copy)]
struct Pull {
    previous_vertex: u32,
    position: Point,
    face: u32,
    fit: f64,
    quadric: Quadric,
}

/// det A relative to (trace A / 3)³ above which a pulled quadric has a minimizer: a pull fixes the
/// directions in which planes leave it open, however many there are.
const MIN_RELATIVE_DETERMINANT: f64 = 1e-9;

impl Pulls {
    /// `None` if nothing is held. `reduction` is how many faces become one: as many planes as it
    /// merges, so much more a pull weighs. `hold` is how much of everything applies, 0 to 1.
    pub fn new(
        anchors: &Anchors,
        normalization: &Normalization,
        vertex_count: usize,
        [reduction, hold]: [f64; 2],
    ) -> Option<Self> {
        let weight = reduction * hold;
        let is_held = anchors.anchors.iter().any(|anchor| 0.0 < anchor.weight);
        if weight == 0.0 || !is_held {
            return None;
        }
        let positions: Vec<Point> = anchors.anchors.iter().map(|a| a.position).collect();
        let positions = normalization.apply(&positions);
        let mut of_vertices = vec![NO_PULL; vertex_count];
        let (mut pulls, mut seen) = (Vec::new(), Vec::new());
        for (anchor, position) in anchors.anchors.iter().zip(positions) {
            let quadric = Quadric::of_point(&position, weight * anchor.weight)
                + Quadric::of_plane(&position, &anchor.normal, reduction * anchor.plane_weight);
            of_vertices[anchor.vertex as usize] = pulls.len() as u32;
            pulls.push(Pull {
                previous_vertex: anchor.previous_vertex,
                position,
                face: anchor.face,
                fit: anchor.fit,
                quadric,
            });
            seen.push(SeenPull {
                quadric: SeenQuadric::new(&quadric, &position),
                fit: anchor.fit as f32,
            });
        }
        Some(Self {
            of_vertices,
            pulls,
            seen,
            merge_penalty: hold * anchors.merge_penalty,
        })
    }

    /// The pulls as edges are ranked by them.
    pub fn seen(&self) -> SeenPulls<'_> {
        SeenPulls {
            of_vertices: &self.of_vertices,
            pulls: &self.seen,
            merge_penalty: self.merge_penalty as f32,
        }
    }

    fn of(&self, vertex: u32) -> Option<&Pull> {
        self.pulls.get(self.of_vertices[vertex as usize] as usize)
    }

    /// The anchor that a vertex kept, with its position normalized.
    pub fn kept(&self, vertex: u32) -> Option<Kept> {
        let pull = self.of(vertex)?;
        Some(Kept {
            position: pull.position,
            face: pull.face,
            fit: pull.fit,
            vertex: pull.previous_vertex,
        })
    }

    /// `b` was merged into `a`, which went to `position`: of two anchors the nearer one stays.
    pub fn merge(&mut self, (a, b): (u32, u32), position: &Point) {
        let square = |pull: &Pull| (pull.position - position).norm_squared();
        let takes_b = match (self.of(a), self.of(b)) {
            (Some(of_a), Some(of_b)) => square(of_b) < square(of_a),
            (None, Some(_)) => true,
            (_, None) => false,
        };
        let of_b = std::mem::replace(&mut self.of_vertices[b as usize], NO_PULL);
        if takes_b {
            self.of_vertices[a as usize] = of_b;
        }
    }

    /// Where the vertices of `edge` would be merged, given the `quadric` of both, and what that
    /// costs. Of two anchors the one that costs less pulls.
    pub fn place(&self, quadric: &Quadric, edge: Edge, (v1, v2): (&Point, &Point)) -> (Point, f64) {
        let pulls = [edge.0, edge.1].map(|vertex| self.of(vertex));
        let mut best: Option<(Point, f64)> = None;
        for pull in pulls.into_iter().flatten() {
            let pulled = *quadric + pull.quadric;
            let Some(position) = pulled.minimizer_above(MIN_RELATIVE_DETERMINANT) else {
                continue;
            };
            let cost = pulled.cost(&position);
            if best.is_none_or(|(_, lowest)| cost < lowest) {
                best = Some((position, cost));
            }
        }
        let (position, cost) = best.unwrap_or_else(|| {
            let position = place(quadric, v1, v2, None);
            (position, quadric.cost(&position))
        });
        let penalty = match pulls {
            [Some(one), Some(other)] => self.merge_penalty * one.fit.min(other.fit),
            _ => 0.0,
        };
        (position, cost * (1.0 + penalty))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TriangleMesh;
    use crate::metrics::consistency;
    use crate::registration::carry;
    use crate::simplification::{Options as Target, simplify, simplify_anchored};
    use crate::spatial::{VertexTree, closest_to_vertices};

    /// A bumpy sheet whose grid is shifted by a share of its spacing, so that the same surface
    /// has other vertices.
    fn sheet(shift: f64) -> TriangleMesh {
        let side = 40u32;
        let at = |i: u32, j: u32| {
            // The outline stays.
            let moved = |k: u32| {
                f64::from(k)
                    + if k.is_multiple_of(side - 1) {
                        0.0
                    } else {
                        shift
                    }
            };
            let (x, y) = (moved(i), moved(j));
            Point::new(x, y, (0.3 * x).sin() + (0.25 * y).cos())
        };
        let positions = (0..side * side).map(|k| at(k / side, k % side)).collect();
        let faces = (0..(side - 1) * (side - 1)).flat_map(|k| {
            let a = k / (side - 1) * side + k % (side - 1);
            [[a, a + side, a + 1], [a + 1, a + side, a + side + 1]]
        });
        TriangleMesh::new(positions, faces.collect()).unwrap()
    }

    fn anchors(previous: &TriangleMesh, source: &TriangleMesh, mesh: &TriangleMesh) -> Anchors {
        let before = TriangleTree::new(source).unwrap();
        let carried = carry(
            previous.positions(),
            &closest_to_vertices(previous, &before),
            (source, source),
            &vec![0; source.vertex_count()],
        );
        let surface = TriangleTree::new(mesh).unwrap();
        Anchors::new((&carried, previous.faces()), &surface, &Options::default())
    }

    /// The share of `next`'s vertices that are within a tenth of its mean edge of one before.
    fn persistence(previous: &TriangleMesh, next: &TriangleMesh) -> f64 {
        let tree = VertexTree::new(previous.positions()).unwrap();
        let radius = 0.1 * next.mean_edge();
        let near = |p: &&Point| tree.nearest(p).1 < radius;
        next.positions().iter().filter(near).count() as f64 / next.vertex_count() as f64
    }

    #[test]
    fn twice_as_many_vertices_come_back_with_anchors() {
        let (before, after) = (sheet(0.0), sheet(0.4));
        let target = Target::to_faces(300);
        let previous = simplify(&before, None, &target).mesh;
        let anchors = anchors(&previous, &before, &after);
        let surface = TriangleTree::new(&after).unwrap();
        let anchored = simplify_anchored(&surface, &anchors, &target).mesh;
        let alone = simplify(&after, None, &target).mesh;
        let (with, without) = (
            persistence(&previous, &anchored),
            persistence(&previous, &alone),
        );
        assert!(2.0 * without < with, "{without} {with}");
    }

    #[test]
    fn more_vertices_and_edges_come_back_with_more_strength() {
        let (before, after) = (sheet(0.0), sheet(0.4));
        let target = Target::to_faces(300);
        let previous = simplify(&before, None, &target).mesh;
        let surface = TriangleTree::new(&after).unwrap();
        let surface_before = TriangleTree::new(&before).unwrap();
        let carried = carry(
            previous.positions(),
            &closest_to_vertices(&previous, &surface_before),
            (surface_before.mesh(), &before),
            &vec![0; surface_before.mesh().vertex_count()],
        );
        let found = [0.0, 0.5, 1.0].map(|strength| {
            let anchors = Anchors::new(
                (&carried, previous.faces()),
                &surface,
                &Options::with_strength(strength),
            );
            let next = simplify_anchored(&surface, &anchors, &target).mesh;
            let carried = previous.clone();
            let found = consistency(&carried, &next).unwrap();
            (found.vertex_persistence, found.edge_persistence)
        });
        assert!(
            found.is_sorted_by(|a, b| a.0 < b.0 && a.1 < b.1),
            "{found:?}"
        );
    }

    #[test]
    fn what_was_carried_far_away_anchors_nothing() {
        let mesh = sheet(0.0);
        let target = Target::to_faces(300);
        let previous = simplify(&mesh, None, &target).mesh;
        let away = mesh
            .positions()
            .iter()
            .map(|p| p + Vector::z() * 50.0)
            .collect();
        let registered = mesh.with_positions(away).unwrap();
        let surface = TriangleTree::new(&mesh).unwrap();
        let carried = carry(
            previous.positions(),
            &closest_to_vertices(&previous, &surface),
            (surface.mesh(), &registered),
            &vec![0; surface.mesh().vertex_count()],
        );
        let options = Options::default();
        let anchors = Anchors::new((&carried, previous.faces()), &surface, &options);
        assert!(anchors.anchors.is_empty());
        let anchored = simplify_anchored(&surface, &anchors, &target);
        let alone = simplify_anchored(&surface, &Anchors::default(), &target);
        assert_eq!(anchored, alone);
    }
}
