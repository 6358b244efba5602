//! Collapses edges, cheap ones first, until the mesh is small enough.

use crate::mesh::{Edge, face_normal};
use crate::spatial::TriangleTree;
use crate::{Face, Point, TriangleMesh};

use super::Quadric;
use super::anchors::{Anchors, Pulls};
use super::attribute_costs::{AttributeCosts, AttributeField, Pairs};
use super::connectivity::Connectivity;
use super::edge_costs::{ByPulls, EdgeCosts, SeenQuadric};
use super::greedy::Greedy;
use super::normalization::Normalization;
use super::passes::Passes;
use super::placement::place;
use super::ranking::Rated;
use super::refinement::{Kept, refine};
use super::seams::Seams;
use super::tracked::{Reference, vertex_quadrics};

/// How far to simplify.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// How many faces are wanted.
    pub target_faces: usize,
    /// Weight of the plane that holds a boundary edge in place, relative to a face's plane.
    ///
    /// Garland and Heckbert, section 6, ask for "a large penalty"; 10 keeps cuffs and fingers
    /// without spending the budget of faces on the outline.
    pub boundary_weight: f64,
    /// The same for an edge along which the texture is cut; there are two such planes, one for
    /// each side.
    pub seam_weight: f64,
    /// Whether [`simplify_anchored`] flips edges of the previous result back and fits the vertices:
    /// a third of its time, and most of what it gains in closeness.
    pub refines: bool,
    /// Attributes that take part in what a collapse costs; none by default. Takes twice the time or more.
    pub attributes: Option<AttributeField>,
}

impl Options {
    /// The usual options for a target.
    #[must_use]
    pub fn to_faces(target_faces: usize) -> Self {
        Self {
            target_faces,
            boundary_weight: 10.0,
            seam_weight: SEAM_WEIGHT,
            refines: true,
            attributes: None,
        }
    }
}

/// A simplified mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct Simplified {
    /// The mesh; its vertices are in the order of the input's.
    pub mesh: TriangleMesh,
    /// Whether it has the asked number of faces, or one more where every collapse that is left
    /// takes two away, or was that small to begin with.
    pub target_reached: bool,
    /// Collapses made.
    pub collapses: usize,
    /// For every wedge of the input, that of `mesh` which it became part of, or
    /// [`NO_WEDGE`]; empty if the input has no wedges.
    pub merged_wedges: Vec<u32>,
}

/// The number of a wedge all of whose faces have collapsed.
pub const NO_WEDGE: u32 = u32::MAX;

/// Simplifies `mesh` to the asked number of faces.
///
/// With a `reference` (the previous frame, registered onto this one) it is Tracked QEM to the
/// letter of the paper; without, the original QEM. Deterministic, and independent of the unit
/// of length. A mesh that has no more faces than asked for comes back as it is.
///
/// Where the mesh has [wedges](crate::mesh::Wedges), a vertex on a seam collapses along the seam or
/// not at all, so that no face comes to lie on both sides of it; with many seams the target may be
/// out of reach.
#[must_use]
pub fn simplify(
    mesh: &TriangleMesh,
    reference: Option<&TriangleMesh>,
    options: &Options,
) -> Simplified {
    simplify_guided(mesh, reference, &Anchors::default(), options).0
}

/// Simplifies the mesh of `surface` so that the vertices and edges that `anchors`
/// carry over from the previous result come back, and fits what is left to the mesh.
///
/// Collapses edges like [`simplify`] without a reference, but holds on to the anchors where that
/// costs little; then refines the result as the anchors' options say. Without anchors, as for a
/// first frame, the result is still fitted.
#[must_use]
pub fn simplify_anchored(
    surface: &TriangleTree,
    anchors: &Anchors,
    options: &Options,
) -> Simplified {
    let mesh = surface.mesh();
    let (simplified, kept) = simplify_guided(mesh, None, anchors, options);
    if simplified.collapses == 0 || !options.refines {
        return simplified;
    }
    let hold = hold(mesh, options);
    if hold == 0.0 {
        return simplified;
    }
    Simplified {
        mesh: refine(
            simplified.mesh,
            surface,
            (&kept, &anchors.previous_faces),
            &anchors.refinement.scaled(hold),
        ),
        ..simplified
    }
}

/// The weight of the planes that hold a seam: enough to keep it in its place, where texels of its
/// other side would show, and no more, since what it costs in faces is missing elsewhere. On textured
/// captures the pictures are best at 0.1 to 0.3, and worse by 0.1 dB at 0 and 1, by 0.3 dB at 10.
const SEAM_WEIGHT: f64 = 0.2;

/// How many faces become one.
fn reduction(mesh: &TriangleMesh, options: &Options) -> f64 {
    mesh.face_count() as f64 / options.target_faces.max(1) as f64
}

/// The reductions between which a result comes to be held and fitted.
///
/// Where few faces become one, vertices stand where the original has them: holding them elsewhere
/// costs more than the original QEM's whole error, and between vertices the original is not known.
const HELD_REDUCTIONS: std::ops::Range<f64> = 1.5..5.0;

/// How much of what holds and fits a result applies, 0 to 1.
fn hold(mesh: &TriangleMesh, options: &Options) -> f64 {
    let std::ops::Range { start, end } = HELD_REDUCTIONS;
    ((reduction(mesh, options) - start) / (end - start)).clamp(0.0, 1.0)
}

fn simplify_guided(
    mesh: &TriangleMesh,
    reference: Option<&TriangleMesh>,
    anchors: &Anchors,
    options: &Options,
) -> (Simplified, Vec<Option<Kept>>) {
    if mesh.face_count() <= options.target_faces {
        let unchanged = Simplified {
            mesh: mesh.clone(),
            target_reached: true,
            collapses: 0,
            merged_wedges: mesh
                .wedges()
                .map_or(Vec::new(), |wedges| (0..wedges.count() as u32).collect()),
        };
        return (unchanged, Vec::new());
    }
    let normalization = Normalization::of(mesh);
    let positions = normalization.apply(mesh.positions());
    let reference = reference.and_then(|r| {
        let positions = normalization.apply(r.positions());
        Reference::new(r, &positions, mesh.vertex_count())
    });
    let connectivity = Connectivity::new(mesh);
    let seams = mesh.wedges().map(|wedges| Seams::new(mesh, wedges));
    let mut collapses = Collapses {
        quadrics: initial_quadrics(mesh, &positions, (&connectivity, seams.as_ref()), options),
        attributes: options
            .attributes
            .as_ref()
            .map(|field| AttributeCosts::new(mesh, &positions, field)),
        seams,
        connectivity,
        versions: vec![0; mesh.vertex_count()],
        seen: Vec::new(),
        by_pulls: ByPulls::default(),
        positions,
        reference,
        pulls: Pulls::new(
            anchors,
            &normalization,
            mesh.vertex_count(),
            [reduction(mesh, options), hold(mesh, options)],
        ),
        count: 0,
    };
    if collapses.reference.is_some() {
        let mut greedy = Greedy::new(mesh.vertex_count());
        collapses.collapse_to(options.target_faces, &mut greedy);
    } else {
        collapses.see_all();
        let mut passes = Passes::new(mesh.vertex_count());
        collapses.collapse_to(options.target_faces, &mut passes);
    }
    collapses.finish(mesh, &normalization, options.target_faces)
}

/// The planes of the faces around each vertex, and at boundary edges and seams a plane through the
/// edge at right angles to its face.
fn initial_quadrics(
    mesh: &TriangleMesh,
    positions: &[Point],
    (connectivity, seams): (&Connectivity, Option<&Seams<'_>>),
    options: &Options,
) -> Vec<Quadric> {
    let mut quadrics = vertex_quadrics(mesh, positions);
    for (index, face) in mesh.faces().iter().enumerate() {
        for corner in 0..3 {
            let edge = Edge::new(face[corner], face[(corner + 1) % 3]);
            let weight = if connectivity.is_boundary(face[corner], face[(corner + 1) % 3]) {
                options.boundary_weight
            } else if seams.is_some_and(|seams| seams.is_seam(index, corner)) {
                options.seam_weight
            } else {
                continue;
            };
            let (a, b) = (positions[edge.0 as usize], positions[edge.1 as usize]);
            let Some(normal) = face_normal(face.map(|corner| positions[corner as usize])) else {
                continue;
            };
            let Some(outward) = (b - a).cross(&normal).try_normalize(0.0) else {
                continue;
            };
            let plane = Quadric::of_plane(&a, &outward, weight);
            quadrics[edge.0 as usize] += plane;
            quadrics[edge.1 as usize] += plane;
        }
    }
    quadrics
}

/// Costs below this (a distance of 1e-9 of the diagonal, squared) are rounding, and all alike.
const NO_COST: f64 = 1e-18;

/// A mesh as its edges collapse.
pub(super) struct Collapses<'a> {
    pub positions: Vec<Point>,
    pub connectivity: Connectivity,
    /// How often each vertex was merged.
    pub versions: Vec<u32>,
    pub reference: Option<Reference>,
    seams: Option<Seams<'a>>,
    attributes: Option<AttributeCosts>,
    quadrics: Vec<Quadric>,
    /// The same as edges are ranked by; empty if they are not.
    seen: Vec<SeenQuadric>,
    by_pulls: ByPulls,
    pulls: Option<Pulls>,
    count: usize,
}

/// What a collapse must respect.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Rules {
    /// Topology, and no face may flip.
    Strict,
    /// Topology only: the last resort before giving up on the target.
    TopologyOnly,
}

/// Which edge is next.
pub(super) trait Order {
    /// Starts with all edges there are.
    fn fill(&mut self, mesh: &mut Collapses<'_>);

    /// Collapses edges until there are `target` faces or none of those that it knows may.
    fn drain(&mut self, mesh: &mut Collapses<'_>, target: usize, rules: Rules);
}

/// How often an order starts again with the same rules, at the most; captures need one or two.
const MAX_ROUNDS: usize = 16;

impl Collapses<'_> {
    /// Collapses edges until `target` is reached or no collapse is left.
    ///
    /// An edge that was refused may become possible when its surroundings change, so the order
    /// starts again as long as that helps.
    fn collapse_to(&mut self, target: usize, order: &mut impl Order) {
        for rules in [Rules::Strict, Rules::TopologyOnly] {
            for _ in 0..MAX_ROUNDS {
                order.fill(self);
                let before = self.count;
                order.drain(self, target, rules);
                // One face too many may be all that the topology allows; flipping faces to get
                // rid of it is not worth it.
                let close = self.connectivity.face_count() <= target + 1;
                if self.connectivity.face_count() <= target || (close && before == self.count) {
                    return;
                }
                if before == self.count {
                    break;
                }
            }
        }
    }

    /// Collapses an edge if the rules allow it and it leaves no fewer than `target` faces. Says
    /// which vertex is left then, and which is gone.
    pub fn try_collapse(&mut self, edge: Edge, target: usize, rules: Rules) -> Option<(u32, u32)> {
        let (a, b) = self.left_and_gone(edge)?;
        let vanishing = self.connectivity.faces_of_collapse(a, b)?;
        if self.connectivity.face_count() < target + vanishing {
            return None;
        }
        let (position, _) = self.evaluate(edge);
        let is_allowed = rules == Rules::TopologyOnly
            || self
                .connectivity
                .keeps_orientation(&self.positions, &position);
        is_allowed.then(|| {
            self.collapse(a, b, position);
            (a, b)
        })
    }

    /// Has the processor fetch what is around edges before it is asked for; changes nothing.
    pub fn read_ahead(&self, edges: impl Iterator<Item = Edge>) {
        let mut read = 0;
        for vertex in edges.flat_map(|Edge(a, b)| [a, b]) {
            read ^= self.connectivity.read_around(vertex);
            let quadric = self.quadrics[vertex as usize].coefficients();
            read ^= (quadric[0].to_bits() ^ quadric[9].to_bits()) as u32;
        }
        std::hint::black_box(read);
    }

    /// Merges `b` into `a`.
    fn collapse(&mut self, a: u32, b: u32, position: Point) {
        if self.attributes.is_some() || self.seams.is_some() {
            let pairs = self.merged_wedges((a, b));
            if let Some(attributes) = &mut self.attributes {
                attributes.merge(&pairs);
            }
            if let Some(seams) = &mut self.seams {
                seams.merge(&pairs);
            }
        }
        self.connectivity.collapse();
        self.positions[a as usize] = position;
        // The frame's own quadrics add up; the reference's are gathered anew for every edge.
        let merged = self.quadrics[a as usize] + self.quadrics[b as usize];
        self.quadrics[a as usize] = merged;
        if let Some(seen) = self.seen.get_mut(a as usize) {
            *seen = SeenQuadric::new(&merged, &position);
        }
        if let Some(pulls) = &mut self.pulls {
            pulls.merge((a, b), &position);
        }
        self.versions[a as usize] += 1;
        self.versions[b as usize] += 1;
        self.count += 1;
    }

    /// Which end of an edge would be left and which be gone; none if it must not collapse.
    fn left_and_gone(&self, edge: Edge) -> Option<(u32, u32)> {
        match &self.seams {
            Some(seams) => seams.left_and_gone(&self.connectivity, edge),
            None => Some((edge.0, edge.1)),
        }
    }

    /// Which wedges become one if a vertex is merged into another; the vertices where there are none.
    fn merged_wedges(&self, (left, gone): (u32, u32)) -> Pairs {
        match &self.seams {
            Some(seams) => seams.pairs(&self.connectivity, (left, gone)),
            None => [Some([left, gone]), None],
        }
    }

    /// What collapsing an edge costs in attributes, by where the merged vertex goes.
    fn attribute_cost(&self, edge: Edge) -> Option<Quadric> {
        let attributes = self.attributes.as_ref()?;
        // One that must not collapse is asked for what it costs all the same.
        let (left, gone) = self.left_and_gone(edge)?;
        Some(attributes.of_merged(left, &self.merged_wedges((left, gone))))
    }

    /// Sees every vertex's quadric from where it is, so that edges can be rated.
    fn see_all(&mut self) {
        let vertices = self.quadrics.iter().zip(&self.positions);
        self.seen = vertices
            .map(|(quadric, position)| SeenQuadric::new(quadric, position))
            .collect();
    }

    /// Rates edges by what collapsing them costs, about.
    pub fn rate(&mut self, edges: &mut [Rated]) {
        if self.attributes.is_some() {
            // What attributes cost does not add up from vertex to vertex.
            for rated in edges {
                rated.cost = self.cost(rated.edge) as f32;
            }
            return;
        }
        let costs = EdgeCosts {
            quadrics: &self.seen,
            pulls: self.pulls.as_ref().map(Pulls::seen),
        };
        costs.rate(edges, &mut self.by_pulls);
        for rated in edges.iter_mut().filter(|rated| rated.cost.is_nan()) {
            rated.cost = self.cost(rated.edge) as f32;
        }
    }

    /// What collapsing an edge costs, rounding taken for nothing.
    pub fn cost(&mut self, edge: Edge) -> f64 {
        let (_, cost) = self.evaluate(edge);
        if cost < NO_COST { 0.0 } else { cost }
    }

    /// Where the edge's vertices would be merged, and what that costs (Eq. 10, 12 and 15).
    fn evaluate(&mut self, edge: Edge) -> (Point, f64) {
        let (a, b) = (edge.0 as usize, edge.1 as usize);
        let (v1, v2) = (&self.positions[a], &self.positions[b]);
        let mut quadric = self.quadrics[a] + self.quadrics[b];
        if let Some(lost) = self.attribute_cost(edge) {
            quadric += lost;
        }
        let mut barycenter = None;
        if let Some(reference) = &mut self.reference {
            let around = reference.around_edge(edge, v1, v2);
            quadric += around.quadric;
            barycenter = around.barycenter;
        }
        if let Some(pulls) = &self.pulls {
            return pulls.place(&quadric, edge, (v1, v2));
        }
        let position = place(&quadric, v1, v2, barycenter.as_ref());
        (position, quadric.cost(&position))
    }

    fn finish(
        &self,
        mesh: &TriangleMesh,
        normalization: &Normalization,
        target: usize,
    ) -> (Simplified, Vec<Option<Kept>>) {
        let faces: Vec<Face> = self.connectivity.faces().collect();
        let mut used = vec![false; self.positions.len()];
        faces
            .iter()
            .flatten()
            .for_each(|&corner| used[corner as usize] = true);
        let mut numbers = vec![0u32; used.len()];
        let mut positions = Vec::new();
        let mut kept = Vec::new();
        for vertex in (0..used.len()).filter(|&vertex| used[vertex]) {
            numbers[vertex] = positions.len() as u32;
            let anchor = self
                .pulls
                .as_ref()
                .and_then(|pulls| pulls.kept(vertex as u32));
            kept.push(anchor.map(|kept| Kept {
                position: normalization.undo(&kept.position),
                ..kept
            }));
            positions.push(if 0 < self.versions[vertex] {
                normalization.undo(&self.positions[vertex])
            } else {
                mesh.positions()[vertex]
            });
        }
        let faces: Vec<Face> = faces
            .iter()
            .map(|f| f.map(|c| numbers[c as usize]))
            .collect();
        let target_reached = faces.len() <= target + 1;
        let mut result = TriangleMesh::from_valid(positions, faces);
        let mut merged_wedges = Vec::new();
        if let Some(seams) = &self.seams {
            let wedges;
            (wedges, merged_wedges) = seams.finish(&self.connectivity, &numbers);
            result = result.with_wedges(wedges);
        }
        let simplified = Simplified {
            mesh: result,
            target_reached,
            collapses: self.count,
            merged_wedges,
        };
        (simplified, kept)
    }
}
