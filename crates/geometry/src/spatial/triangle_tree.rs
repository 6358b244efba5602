//! Closest point on a triangle mesh.

use wide::f32x8;

use crate::{Point, TriangleMesh};

use super::box_tree::{Bounds, BoxTree, nearest_of};
use super::closest_point_on_triangle;
use super::straight_walk::{straight_below, straight_walk};
use super::triangle_pack::{PACK, TrianglePack};

/// The point of a surface that is closest to a query.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// Where it is.
    pub position: Point,
    /// The face it lies on; the lowest-numbered of several is not guaranteed.
    pub face: u32,
    /// Its distance from the query.
    pub distance: f64,
}

/// A tree of boxes over the faces of a mesh.
///
/// The boxes are in `f32`, relative to the mesh's own box and grown by more than their
/// rounding. Triangles that are close to each other are looked at eight at a time in `f32`, and those
/// of them that may be the closest again in `f64`, so that the distances are exact to rounding.
pub struct TriangleTree {
    boxes: BoxTree,
    /// One for every group of the boxes.
    packs: Vec<TrianglePack>,
    mesh: TriangleMesh,
    origin: Point,
    scale: f64,
}

impl std::fmt::Debug for TriangleTree {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("TriangleTree")
            .field("triangles", &self.mesh.face_count())
            .finish()
    }
}

/// How far boxes are grown, in units of the mesh's diagonal: above the rounding of `f32`
/// (6e-8) after one subtraction and one product.
const BOX_MARGIN: f32 = 5e-7;

/// Further away than this, in units of the mesh's diagonal, squares might leave `f32`: there
/// every triangle is looked at.
const FAR_AWAY: f32 = 1e15;

impl TriangleTree {
    /// Builds the tree; `None` for a mesh without faces, which has no closest point.
    #[must_use]
    pub fn new(mesh: &TriangleMesh) -> Option<Self> {
        if mesh.face_count() == 0 {
            return None;
        }
        Some(Self::with_boxes(mesh, |bounds_of| {
            BoxTree::new(mesh.face_count(), PACK, bounds_of)
        }))
    }

    /// The tree over `mesh`, which has the faces of the one that this tree is over at other
    /// positions. As exact as a new one and made in a fraction of the time; slower to search the
    /// further faces have come away from their neighbors.
    ///
    /// # Panics
    ///
    /// If `mesh` has fewer faces.
    #[must_use]
    pub fn refitted(&self, mesh: &TriangleMesh) -> Self {
        Self::with_boxes(mesh, |bounds_of| self.boxes.refitted(bounds_of))
    }

    /// A tree with the boxes that `make` puts around faces.
    fn with_boxes(
        mesh: &TriangleMesh,
        make: impl FnOnce(&dyn Fn(u32) -> Bounds) -> BoxTree,
    ) -> Self {
        let bounds = mesh.bounding_box();
        let diagonal = bounds.diagonal();
        let (origin, scale) = (
            bounds.center(),
            if diagonal > 0.0 { 1.0 / diagonal } else { 1.0 },
        );
        let relative: Vec<[f32; 3]> = mesh
            .positions()
            .iter()
            .map(|p| relative(p, &origin, scale))
            .collect();
        let boxes = make(&|face| {
            let corners = mesh.faces()[face as usize].map(|corner| relative[corner as usize]);
            grown_box(corners)
        });
        let pack = |faces: &[u32]| {
            let mut triangles = [[[0.0; 3]; 3]; PACK];
            for (triangle, &face) in triangles.iter_mut().zip(faces) {
                *triangle = mesh.faces()[face as usize].map(|corner| relative[corner as usize]);
            }
            TrianglePack::new(&triangles[..faces.len()])
        };
        Self {
            packs: boxes.items().chunks(PACK).map(pack).collect(),
            boxes,
            mesh: mesh.clone(),
            origin,
            scale,
        }
    }

    /// The mesh whose surface it is.
    #[must_use]
    #[inline]
    pub fn mesh(&self) -> &TriangleMesh {
        &self.mesh
    }

    /// The point of the surface closest to `query`.
    #[must_use]
    pub fn closest(&self, query: &Point) -> SurfacePoint {
        let anything = SurfacePoint {
            position: self.mesh.triangle(0)[0],
            face: 0,
            distance: f64::INFINITY,
        };
        self.closer_than(anything, NONE, query)
    }

    /// The same, told a face that is probably near: the answer of the last search for a query
    /// that has moved a little since. A good guess saves most of the search; the result is as
    /// exact with a bad one.
    ///
    /// # Panics
    ///
    /// If there is no such face.
    #[must_use]
    pub fn closest_from(&self, query: &Point, guess: u32) -> SurfacePoint {
        let position = closest_point_on_triangle(query, &self.mesh.triangle(guess as usize));
        let guessed = SurfacePoint {
            position,
            face: guess,
            distance: (query - position).norm(),
        };
        self.closer_than(guessed, guess, query)
    }

    /// About the same: the point that `query` is straight above, found by walking from face to face
    /// from `guess` on, if that is closer than `near`; the closest of all where the way ends otherwise.
    ///
    /// A tenth of the search's time where the guess is near.
    ///
    /// # Panics
    ///
    /// If there is no such face.
    #[must_use]
    pub fn below_or_closest(&self, query: &Point, guess: u32, near: f64) -> SurfacePoint {
        match straight_walk(&self.mesh, query, guess) {
            Ok(below) if below.distance <= near => below,
            Ok(SurfacePoint { face, .. }) | Err(face) => self.closest_from(query, face),
        }
    }

    /// The foot of the perpendicular from `query` to the plane of a face, if it is on the face.
    ///
    /// # Panics
    ///
    /// If there is no such face.
    #[must_use]
    pub fn straight_below(&self, query: &Point, face: u32) -> Option<SurfacePoint> {
        straight_below(&self.mesh, query, face)
    }

    /// The point of the surface closest to `query`, or `known`, if none is closer than that; the
    /// face that was `tried` for it is left out.
    ///
    /// A close one saves most of the search.
    fn closer_than(&self, known: SurfacePoint, tried: u32, query: &Point) -> SurfacePoint {
        let relative = relative(query, &self.origin, self.scale);
        let mut best = Best::of(known, tried, query, &relative, self);
        if best.extent < FAR_AWAY {
            self.boxes
                .visit_nearest(&relative, best.box_bound(), |pack| {
                    best.try_pack(pack);
                    best.box_bound()
                });
        } else {
            (0..self.mesh.face_count() as u32).for_each(|face| best.try_face(face));
        }
        SurfacePoint {
            distance: best.square.sqrt(),
            ..best.found
        }
    }
}

/// Boxes are grown by more than their own rounding; this factor on the squared distance covers
/// that of the distance itself and of a query's coordinates away from the mesh.
const BOUND_MARGIN: f64 = 1.0 + 4e-5;

/// The number of no face.
const NONE: u32 = u32::MAX;

/// The closest point that a search has found.
struct Best<'a> {
    query: &'a Point,
    tree: &'a TriangleTree,
    /// The query relative to the mesh, and its largest coordinate there.
    lanes: [f32x8; 3],
    extent: f32,
    /// Of the distance.
    square: f64,
    found: SurfacePoint,
    /// A face that is not looked at again.
    tried: u32,
}

impl<'a> Best<'a> {
    fn of(
        found: SurfacePoint,
        tried: u32,
        query: &'a Point,
        relative: &[f32; 3],
        tree: &'a TriangleTree,
    ) -> Self {
        Self {
            query,
            tree,
            lanes: relative.map(f32x8::splat),
            extent: relative.iter().fold(0.0, |most, c| c.abs().max(most)),
            square: found.distance * found.distance,
            found,
            tried,
        }
    }

    /// The square of the distance of boxes that may have something closer.
    #[inline]
    fn box_bound(&self) -> f32 {
        let scale = self.tree.scale;
        (self.square * (scale * scale) * BOUND_MARGIN) as f32
    }

    #[inline]
    fn try_pack(&mut self, number: u32) {
        let pack = &self.tree.packs[number as usize];
        let squares = pack.least_squares(&self.lanes);
        let mut left = (1 << PACK) - 1;
        loop {
            let distance = (self.square.sqrt() * self.tree.scale) as f32;
            let bound = pack.bound(distance, self.extent);
            left &= squares.simd_lt(f32x8::splat(bound)).to_bitmask();
            if left == 0 {
                return;
            }
            let lane = nearest_of(squares, left);
            left &= !(1 << lane);
            let slot = PACK * number as usize + lane as usize;
            // Lanes that stand for missing triangles have no face.
            match self.tree.boxes.items().get(slot) {
                Some(&face) if face != self.tried => self.try_face(face),
                Some(_) | None => {}
            }
        }
    }

    #[inline]
    fn try_face(&mut self, face: u32) {
        let triangle = self.tree.mesh.triangle(face as usize);
        let position = closest_point_on_triangle(self.query, &triangle);
        let square = (self.query - position).norm_squared();
        if square < self.square {
            self.square = square;
            self.found.position = position;
            self.found.face = face;
        }
    }
}

fn relative(point: &Point, origin: &Point, scale: f64) -> [f32; 3] {
    ((point - origin) * scale).map(|c| c as f32).into()
}

fn grown_box([a, b, c]: [[f32; 3]; 3]) -> [[f32; 3]; 2] {
    let at = |axis: usize| [a[axis], b[axis], c[axis]];
    let min = |[a, b, c]: [f32; 3]| a.min(b).min(c) - BOX_MARGIN;
    let max = |[a, b, c]: [f32; 3]| a.max(b).max(c) + BOX_MARGIN;
    [
        [min(at(0)), min(at(1)), min(at(2))],
        [max(at(0)), max(at(1)), max(at(2))],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn cloud_of_triangles(corners: &[[f64; 3]], unit: f64) -> TriangleMesh {
        let positions: Vec<Point> = corners.iter().map(|&c| Point::from(c) * unit).collect();
        let faces = (0..corners.len() as u32 / 3)
            .map(|f| [3 * f, 3 * f + 1, 3 * f + 2])
            .collect();
        TriangleMesh::new(positions, faces).unwrap()
    }

    proptest! {
        /// The tree finds what looking at every triangle finds, in any unit.
        #[test]
        fn the_tree_agrees_with_looking_at_every_triangle(
            corners in prop::collection::vec(prop::array::uniform3(-1.0..1.0_f64), 3..120),
            query in prop::array::uniform3(-3.0..3.0_f64),
            unit in prop::sample::select(vec![1e-6, 1.0, 1e6]),
        ) {
            let mesh = cloud_of_triangles(&corners, unit);
            let query = Point::from(query) * unit;
            let brute = (0..mesh.face_count())
                .map(|f| (query - closest_point_on_triangle(&query, &mesh.triangle(f))).norm())
                .fold(f64::INFINITY, f64::min);
            let tree = TriangleTree::new(&mesh).unwrap();
            prop_assert!((tree.closest(&query).distance - brute).abs() <= 1e-12 * unit);
            for guess in 0..mesh.face_count() as u32 {
                let found = tree.closest_from(&query, guess);
                prop_assert!((found.distance - brute).abs() <= 1e-12 * unit);
            }
        }
    }

    proptest! {
        /// A tree that was fitted to other positions is as exact as one made for them.
        #[test]
        fn a_refitted_tree_agrees_with_looking_at_every_triangle(
            corners in prop::collection::vec(
                (prop::array::uniform3(-1.0..1.0_f64), prop::array::uniform3(-1.0..1.0_f64)),
                3..120,
            ),
            query in prop::array::uniform3(-3.0..3.0_f64),
        ) {
            let (before, after): (Vec<_>, Vec<_>) = corners.into_iter().unzip();
            let tree = TriangleTree::new(&cloud_of_triangles(&before, 1.0)).unwrap();
            let mesh = cloud_of_triangles(&after, 1e3);
            let query = Point::from(query) * 1e3;
            let brute = (0..mesh.face_count())
                .map(|f| (query - closest_point_on_triangle(&query, &mesh.triangle(f))).norm())
                .fold(f64::INFINITY, f64::min);
            let found = tree.refitted(&mesh).closest(&query);
            prop_assert!((found.distance - brute).abs() <= 1e-9);
            let there = closest_point_on_triangle(&query, &mesh.triangle(found.face as usize));
            prop_assert!((there - found.position).norm() <= 1e-9);
        }
    }

    #[test]
    fn a_query_beyond_the_range_of_f32_is_answered() {
        let mesh = cloud_of_triangles(&[[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]], 1e-9);
        let tree = TriangleTree::new(&mesh).unwrap();
        let found = tree.closest(&Point::new(1e18, 0.0, 0.0));
        assert_eq!((found.face, found.distance), (0, 1e18));
    }

    #[test]
    fn the_closest_of_slivers_and_of_faces_without_area_is_found() {
        for height in [0.0, 1e-9, 1e-5] {
            let sliver = |k: u32| {
                let x = f64::from(k);
                [[x, 0., 0.], [x, 1., 0.], [x + height, 0.5, 0.]]
            };
            let corners: Vec<[f64; 3]> = (0..40).flat_map(sliver).collect();
            let tree = TriangleTree::new(&cloud_of_triangles(&corners, 1.0)).unwrap();
            let found = tree.closest(&Point::new(17.1, 0.2, 0.3));
            assert_eq!(found.face, 17, "{height}");
            let expected = (0.1_f64 - height * 0.4).hypot(0.3);
            assert!((found.distance - expected).abs() < 1e-6, "{height}");
        }
    }

    #[test]
    fn only_a_point_above_a_face_is_straight_above_it() {
        let mesh = cloud_of_triangles(&[[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]], 1.0);
        let tree = TriangleTree::new(&mesh).unwrap();
        let above = tree
            .straight_below(&Point::new(0.25, 0.5, -2.0), 0)
            .unwrap();
        assert!((above.position - Point::new(0.25, 0.5, 0.0)).norm() < 1e-12);
        assert!((above.distance - 2.0).abs() < 1e-12);
        assert!(tree.straight_below(&Point::new(0.6, 0.6, 1.0), 0).is_none());
    }
}
