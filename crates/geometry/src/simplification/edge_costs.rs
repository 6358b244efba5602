//! What collapsing edges costs, eight at a time in `f32`: exact enough to rank them.
//!
//! Planes are seen from the vertex that they belong to, so that little is lost by rounding: what is
//! left of a cost is the square of some millionth of an edge.

use wide::f32x8;

use crate::Point;
use crate::mesh::Edge;

use super::Quadric;
use super::ranking::Rated;

/// Edges that are looked at together.
const LANES: usize = 8;

/// A quadric seen from a place: xᵀAx + 2b·x + c with x from there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SeenQuadric {
    /// A's entries xx, xy, xz, yy, yz, zz.
    a: [f32; 6],
    b: [f32; 3],
    c: f32,
    /// The place.
    from: [f32; 3],
}

impl SeenQuadric {
    pub fn new(quadric: &Quadric, from: &Point) -> Self {
        let [xx, xy, xz, yy, yz, zz, bx, by, bz, _] = quadric.coefficients();
        let b = [
            xx * from.x + xy * from.y + xz * from.z + bx,
            xy * from.x + yy * from.y + yz * from.z + by,
            xz * from.x + yz * from.y + zz * from.z + bz,
        ];
        Self {
            a: [xx, xy, xz, yy, yz, zz].map(|entry| entry as f32),
            b: b.map(|entry| entry as f32),
            c: quadric.cost(from) as f32,
            from: from.coords.map(|c| c as f32).into(),
        }
    }
}

/// What pulls a vertex, as its merged vertex is ranked by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SeenPull {
    /// Seen from where it pulls to.
    pub quadric: SeenQuadric,
    /// How well its anchor fits, 0 to 1; 0 where nothing pulls.
    pub fit: f32,
}

impl SeenPull {
    /// Of a vertex that nothing pulls.
    pub const NONE: Self = Self {
        quadric: SeenQuadric {
            a: [0.0; 6],
            b: [0.0; 3],
            c: 0.0,
            from: [0.0; 3],
        },
        fit: 0.0,
    };
}

/// What pulls the vertices, and what merging two of those costs.
pub(super) struct SeenPulls<'a> {
    /// By vertex, which of the pulls is its own, or [`NO_PULL`].
    pub of_vertices: &'a [u32],
    pub pulls: &'a [SeenPull],
    pub merge_penalty: f32,
}

/// The number of the pull of a vertex that has none.
pub(super) const NO_PULL: u32 = u32::MAX;

/// The vertices' quadrics and, if anything is held, their pulls.
pub(super) struct EdgeCosts<'a> {
    pub quadrics: &'a [SeenQuadric],
    pub pulls: Option<SeenPulls<'a>>,
}

/// Places of edges in a list, by how many of their ends are pulled: those alike are rated together.
/// Kept for its allocations.
#[derive(Default)]
pub(super) struct ByPulls([Vec<u32>; 3]);

impl EdgeCosts<'_> {
    /// Writes the cost of every edge; one that cannot be told in `f32` is NaN.
    pub fn rate(&self, edges: &mut [Rated], by_pulls: &mut ByPulls) {
        let ByPulls(places) = by_pulls;
        places.iter_mut().for_each(Vec::clear);
        for (place, Rated { edge, .. }) in (0..).zip(edges.iter()) {
            let pulled = usize::from(self.is_pulled(edge.0)) + usize::from(self.is_pulled(edge.1));
            places[pulled].push(place);
        }
        for (pulled, places) in places.iter().enumerate() {
            for places in places.chunks(LANES) {
                let last = places.len() - 1;
                // The last edge stands for those that are missing.
                let lanes = std::array::from_fn(|lane| edges[places[lane.min(last)] as usize].edge);
                let costs = match pulled {
                    0 => self.alone(&lanes),
                    1 => self.pulled_at_one(&lanes),
                    _ => self.pulled_at_both(&lanes),
                };
                for (&place, cost) in places.iter().zip(costs.to_array()) {
                    edges[place as usize].cost = cost;
                }
            }
        }
    }

    fn is_pulled(&self, vertex: u32) -> bool {
        let pulls = self.pulls.as_ref();
        pulls.is_some_and(|pulls| pulls.of_vertices[vertex as usize] != NO_PULL)
    }

    fn alone(&self, edges: &[Edge; LANES]) -> f32x8 {
        let (planes, noise) = self.planes(edges);
        without(noise, planes.least())
    }

    fn pulled_at_one(&self, edges: &[Edge; LANES]) -> f32x8 {
        let (planes, noise) = self.planes(edges);
        let pulled = edges.map(|edge| {
            if self.is_pulled(edge.0) {
                edge.0
            } else {
                edge.1
            }
        });
        without(noise, planes.pulled(&self.pulls_of(pulled)))
    }

    /// Of two pulls the one that costs less counts.
    fn pulled_at_both(&self, edges: &[Edge; LANES]) -> f32x8 {
        let (planes, noise) = self.planes(edges);
        let (ones, others) = (edges.map(|edge| edge.0), edges.map(|edge| edge.1));
        let (ones, others) = (self.pulls_of(ones), self.pulls_of(others));
        let (by_one, by_other) = (planes.pulled(&ones), planes.pulled(&others));
        let fits = |pulls: [&SeenPull; LANES]| f32x8::new(pulls.map(|pull| pull.fit));
        let penalty = self.pulls.as_ref().map_or(0.0, |pulls| pulls.merge_penalty);
        let factor = fits(ones).fast_min(fits(others)) * penalty + f32x8::ONE;
        // Where one of them is not a number the sum is none, and nothing else may hide it.
        let unknown = by_one + by_other;
        let least = unknown.is_nan().select(unknown, by_one.fast_min(by_other));
        without(noise, least) * factor
    }

    fn pulls_of(&self, vertices: [u32; LANES]) -> [&SeenPull; LANES] {
        const NONE: &SeenPull = &SeenPull::NONE;
        vertices.map(|vertex| {
            let pulls = self.pulls.as_ref();
            let pull = pulls.and_then(|pulls| {
                let number = pulls.of_vertices[vertex as usize];
                pulls.pulls.get(number as usize)
            });
            pull.unwrap_or(NONE)
        })
    }

    /// The planes of both ends, and costs that are rounding.
    #[inline]
    fn planes(&self, edges: &[Edge; LANES]) -> (Lanes, f32x8) {
        let of = |vertex: u32| &self.quadrics[vertex as usize];
        let first = Lanes::gather(edges.map(|edge| of(edge.0)));
        let second = Lanes::gather(edges.map(|edge| of(edge.1)));
        let (planes, square) = first.plus(&second);
        let noise = (planes.a[0] + planes.a[3] + planes.a[5]) * square * NOISE;
        (planes, noise)
    }
}

#[inline]
fn without(noise: f32x8, cost: f32x8) -> f32x8 {
    cost.simd_lt(noise).select(f32x8::ZERO, cost)
}

/// Costs below this share of the planes' weight times the edge's square are rounding.
const NOISE: f32 = 4e-7;

/// det A relative to (trace A / 3)³ below which `f32` does not tell where the minimum is.
const MIN_RELATIVE_DETERMINANT: f32 = 1e-4;

/// Eight quadrics.
#[derive(Clone, Copy)]
struct Lanes {
    a: [f32x8; 6],
    b: [f32x8; 3],
    c: f32x8,
    from: [f32x8; 3],
}

impl Lanes {
    #[inline]
    fn gather(of: [&SeenQuadric; LANES]) -> Self {
        Self {
            a: std::array::from_fn(|i| f32x8::new(of.map(|quadric| quadric.a[i]))),
            b: std::array::from_fn(|i| f32x8::new(of.map(|quadric| quadric.b[i]))),
            c: f32x8::new(of.map(|quadric| quadric.c)),
            from: std::array::from_fn(|i| f32x8::new(of.map(|quadric| quadric.from[i]))),
        }
    }

    /// The sum, seen from where these are seen from, and the squares of the distances between both
    /// places.
    #[inline]
    fn plus(&self, other: &Self) -> (Self, f32x8) {
        let d: [f32x8; 3] = std::array::from_fn(|i| other.from[i] - self.from[i]);
        let along = product(&other.a, &d);
        let sum = Self {
            a: std::array::from_fn(|i| self.a[i] + other.a[i]),
            b: std::array::from_fn(|i| self.b[i] + other.b[i] - along[i]),
            c: self.c + other.c + (dot(&d, &along) - dot(&other.b, &d) * 2.0),
            from: self.from,
        };
        (sum, dot(&d, &d))
    }

    /// The least cost with a pull.
    #[inline]
    fn pulled(&self, pulls: &[&SeenPull; LANES]) -> f32x8 {
        let pull = Self::gather(pulls.map(|pull| &pull.quadric));
        self.plus(&pull).0.least()
    }

    /// The least cost; NaN where `f32` does not tell.
    #[inline]
    fn least(&self) -> f32x8 {
        let [xx, xy, xz, yy, yz, zz] = self.a;
        // The adjugate of A, which is symmetric too.
        let adjugate = [
            yy * zz - yz * yz,
            yz * xz - xy * zz,
            xy * yz - yy * xz,
            xx * zz - xz * xz,
            xy * xz - xx * yz,
            xx * yy - xy * xy,
        ];
        let determinant = xx * adjugate[0] + xy * adjugate[1] + xz * adjugate[2];
        let mean = (xx + yy + zz) * (1.0 / 3.0);
        let is_told = determinant.simd_gt(mean * mean * mean * MIN_RELATIVE_DETERMINANT);
        let drop = dot(&self.b, &product(&adjugate, &self.b)) / determinant;
        let least = (self.c - drop).fast_max(f32x8::ZERO);
        is_told.select(least, f32x8::splat(f32::NAN))
    }
}

/// A·x for a symmetric A.
#[inline]
fn product([xx, xy, xz, yy, yz, zz]: &[f32x8; 6], x: &[f32x8; 3]) -> [f32x8; 3] {
    [
        *xx * x[0] + *xy * x[1] + *xz * x[2],
        *xy * x[0] + *yy * x[1] + *yz * x[2],
        *xz * x[0] + *yz * x[1] + *zz * x[2],
    ]
}

#[inline]
fn dot(a: &[f32x8; 3], b: &[f32x8; 3]) -> f32x8 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Vector;
    use proptest::prelude::*;

    /// Planes through a place, in three directions that are far from each other.
    fn corner() -> impl Strategy<Value = (Point, Quadric)> {
        let place = prop::array::uniform3(0.0..1.0_f64);
        (place, prop::array::uniform9(-0.3..0.3_f64)).prop_map(|(place, lean)| {
            let place = Point::from(place);
            let planes = [Vector::x(), Vector::y(), Vector::z()]
                .into_iter()
                .enumerate();
            let quadric = planes.fold(Quadric::default(), |sum, (axis, direction)| {
                let lean = Vector::from_column_slice(&lean[3 * axis..][..3]);
                sum + Quadric::of_plane(&place, &(direction + lean).normalize(), 1.0)
            });
            (place, quadric)
        })
    }

    proptest! {
        /// Ranked costs are the exact ones to some millionths of what the edge could cost, with no
        /// pull, with one at either end, and with two.
        #[test]
        fn costs_in_f32_are_about_those_in_f64(
            corners in prop::collection::vec(corner(), 12),
            is_pulled in prop::collection::vec(any::<bool>(), 12),
        ) {
            let seen: Vec<SeenQuadric> = corners
                .iter()
                .map(|(place, quadric)| SeenQuadric::new(quadric, place))
                .collect();
            let pull = |(place, is_pulled): (&Point, bool)| {
                let to = place + Vector::new(0.01, -0.02, 0.03);
                let quadric = Quadric::of_point(&to, 0.5);
                let seen = SeenPull { quadric: SeenQuadric::new(&quadric, &to), fit: 0.8 };
                if is_pulled { (quadric, seen) } else { (Quadric::default(), SeenPull::NONE) }
            };
            let of_vertices: Vec<u32> = (0..)
                .zip(&is_pulled)
                .map(|(vertex, is_pulled)| if *is_pulled { vertex } else { NO_PULL })
                .collect();
            let places = corners.iter().map(|(place, _)| place);
            let (exact, pulls): (Vec<_>, Vec<_>) =
                places.zip(is_pulled.iter().copied()).map(pull).unzip();
            let costs = EdgeCosts { quadrics: &seen, pulls: Some(SeenPulls { of_vertices: &of_vertices, pulls: &pulls, merge_penalty: 2.0 }) };
            let edges = (0..11).map(|first| Rated { edge: Edge(first, first + 1), cost: 0.0 });
            let mut edges: Vec<Rated> = edges.collect();
            costs.rate(&mut edges, &mut ByPulls::default());
            for Rated { edge, cost } in edges {
                let (a, b) = (edge.0 as usize, edge.1 as usize);
                let planes = corners[a].1 + corners[b].1;
                let least = |quadric: Quadric| quadric.cost(&quadric.minimizer().unwrap());
                let pulled = [a, b].into_iter().filter(|&end| is_pulled[end]);
                let pulled: Vec<f64> = pulled.map(|end| least(planes + exact[end])).collect();
                let expected = match pulled[..] {
                    [] => least(planes),
                    [one] => one,
                    _ => pulled[0].min(pulled[1]) * (1.0 + 0.8 * 2.0),
                };
                let size = 3.0 * (corners[a].0 - corners[b].0).norm_squared();
                prop_assert!((f64::from(cost) - expected).abs() <= 4e-6 * size, "{cost} {expected}");
            }
        }
    }

    #[test]
    fn an_edge_in_a_plane_costs_nothing_and_is_not_told() {
        let quadric = Quadric::of_plane(&Point::origin(), &Vector::z(), 6.0);
        let at = |x: f64| SeenQuadric::new(&quadric, &Point::new(x, 0.3, 0.0));
        let seen = [at(0.1), at(0.2)];
        let costs = EdgeCosts {
            quadrics: &seen,
            pulls: None,
        };
        let mut edges = [Rated {
            edge: Edge(0, 1),
            cost: 0.0,
        }];
        costs.rate(&mut edges, &mut ByPulls::default());
        assert!(edges[0].cost.is_nan());
    }
}
