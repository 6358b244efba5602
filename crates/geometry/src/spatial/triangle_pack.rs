//! Eight triangles at once, about.

use wide::f32x8;

/// Triangles of a pack.
pub(super) const PACK: usize = 8;

/// Eight triangles, by the planes that bound them: one through each, and three at right angles to
/// that, one through each edge. A vector for each coordinate.
#[derive(Clone, Copy)]
pub(super) struct TrianglePack {
    /// The first corners: all but the last plane go through them.
    a: Vectors,
    normal: Vectors,
    /// Away from the triangle, across ab, ca and bc.
    outwards: [Vectors; 3],
    /// How far the last plane is from the first corner.
    height: f32x8,
    /// The largest ratio of a triangle's size to its height, and that times its size.
    slimness: f32,
    slack: f32,
}

/// x, y and z of eight vectors.
type Vectors = [f32x8; 3];

/// Half a unit in the last place is 2⁻²⁴ of a number; a dozen operations add up to less than this.
const ROUNDING: f32 = 1e-6;

/// Slimmer triangles, and those without area, have no planes: nothing is known of them.
const MAX_SLIMNESS: f32 = 1e3;

impl TrianglePack {
    /// One to eight triangles; the last one stands for those that are missing.
    ///
    /// # Panics
    ///
    /// If there is none.
    pub fn new(triangles: &[[[f32; 3]; 3]]) -> Self {
        let corner = |corner: usize| {
            std::array::from_fn(|axis| {
                f32x8::new(std::array::from_fn(|lane| {
                    triangles[lane.min(triangles.len() - 1)][corner][axis]
                }))
            })
        };
        let [a, b, c] = [corner(0), corner(1), corner(2)];
        let (ab, bc, ca) = (minus(&b, &a), minus(&c, &b), minus(&a, &c));
        let normal = cross(&ab, &bc);
        let area = square(&normal).sqrt();
        let longest = [&ab, &bc, &ca].map(square);
        let longest = longest[0].fast_max(longest[1]).fast_max(longest[2]);
        // Of triangles without area this is infinite or not a number.
        let slimness = longest / area;
        let is_known = slimness.simd_lt(f32x8::splat(MAX_SLIMNESS));
        let known = |vectors: Vectors| vectors.map(|axis| is_known.select(axis, f32x8::ZERO));
        let unit = |vectors: &Vectors| times(vectors, f32x8::ONE / square(vectors).sqrt());
        let normal = unit(&normal);
        let outwards = [&ab, &ca, &bc].map(|edge| known(unit(&cross(edge, &normal))));
        let slimness = is_known.select(slimness, f32x8::ZERO);
        let largest = |of: f32x8| of.to_array().into_iter().fold(0.0, f32::max);
        Self {
            height: dot(&outwards[2], &ab),
            a,
            normal: known(normal),
            outwards,
            slimness: ROUNDING * largest(slimness),
            slack: ROUNDING * largest(slimness * longest.sqrt()),
        }
    }

    /// Squares of what the distances from `point` are at the least, but for rounding: those to the
    /// plane and, within that, to the planes through the edges. They are the distances themselves
    /// but where a corner is closest.
    #[inline]
    pub fn least_squares(&self, point: &Vectors) -> f32x8 {
        let from_a = minus(point, &self.a);
        let above = dot(&self.normal, &from_a);
        let [ab, ca, bc] = &self.outwards;
        let beside = dot(ab, &from_a)
            .fast_max(dot(ca, &from_a))
            .fast_max(dot(bc, &from_a) - self.height)
            .fast_max(f32x8::ZERO);
        above * above + beside * beside
    }

    /// What [`Self::least_squares`] are below where a distance is below `distance`, from a query
    /// whose largest coordinate is `extent`; both in the unit in which the mesh's diagonal is 1.
    #[inline]
    pub fn bound(&self, distance: f32, extent: f32) -> f32 {
        // Before anything is found there is no distance, and nothing times infinity is no number.
        let distance = distance.min(f32::MAX);
        let rounding = distance * self.slimness + self.slack + ROUNDING * (1.0 + extent);
        let reach = distance * (1.0 + ROUNDING) + rounding;
        reach * reach
    }
}

#[inline]
fn minus(a: &Vectors, b: &Vectors) -> Vectors {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline]
fn times(a: &Vectors, factor: f32x8) -> Vectors {
    [a[0] * factor, a[1] * factor, a[2] * factor]
}

#[inline]
fn cross(a: &Vectors, b: &Vectors) -> Vectors {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

#[inline]
fn dot(a: &Vectors, b: &Vectors) -> f32x8 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline]
fn square(a: &Vectors) -> f32x8 {
    dot(a, a)
}
