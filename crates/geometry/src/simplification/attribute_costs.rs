//! What merging vertices costs in attributes: colors, normals and texture coordinates that are no
//! longer where they were.

use crate::mesh::{Rows, Wedges, face_normal};
use crate::{Point, TriangleMesh};

use super::Quadric;

/// Attributes at the corners of a mesh's faces, to be kept in place.
#[derive(Debug, Clone, PartialEq)]
pub struct AttributeField {
    /// For every face and corner a value for each channel. A difference of 1 counts as much as a
    /// distance of the whole diagonal of the mesh's bounding box.
    pub corners: Vec<[[f64; CHANNELS]; 3]>,
    /// How many channels are in use, from the first on.
    pub channels: usize,
}

/// The most channels: four of a color, three of a normal, two texture coordinates.
pub const CHANNELS: usize = 9;

/// How far the attributes around a wedge are from what they are at one point, as a function of that
/// point.
///
/// On a face an attribute is linear in the position, g·p + d with g in the face's plane. The sum
/// over faces of w (g·p + d − s)² has its least over s, the merged wedge's own value, at the faces' mean:
/// what is left is quadratic in p alone, so that vertices are placed for shape and attributes at once.
///
/// # Source
///
/// Hoppe, "New quadric metric for simplifying meshes with appearance attributes", IEEE Visualization
/// 1999, sections 3 and 4 (with wedges, 5), <https://doi.org/10.1109/VISUAL.1999.809869>.
#[derive(Debug, Clone, Copy)]
struct AttributeQuadric {
    /// Sums of w ggᵀ (xx, xy, xz, yy, yz, zz), w d g and w d², over faces and channels.
    squares: [f64; 10],
    /// By channel, sums of w g and w d.
    linear: [[f64; 4]; CHANNELS],
    /// The sum of w.
    weight: f64,
}

impl AttributeQuadric {
    const NONE: Self = Self {
        squares: [0.0; 10],
        linear: [[0.0; 4]; CHANNELS],
        weight: 0.0,
    };

    fn add(&mut self, other: &Self) {
        let linear = self.linear.as_flattened_mut().iter_mut();
        for (sum, term) in linear.zip(other.linear.as_flattened()) {
            *sum += term;
        }
        for (sum, term) in self.squares.iter_mut().zip(other.squares) {
            *sum += term;
        }
        self.weight += other.weight;
    }

    /// What is left with the best values, as a function of the position.
    fn with_best_values(&self, channels: usize) -> [f64; 10] {
        let mut left = self.squares;
        if self.weight <= 0.0 {
            return left;
        }
        for linear in &self.linear[..channels] {
            for (entry, square) in left.iter_mut().zip(squares(linear)) {
                *entry -= square / self.weight;
            }
        }
        left
    }
}

/// The coefficients of (g·p + d)².
fn squares([x, y, z, d]: &[f64; 4]) -> [f64; 10] {
    [
        x * x,
        x * y,
        x * z,
        y * y,
        y * z,
        z * z,
        x * d,
        y * d,
        z * d,
        d * d,
    ]
}

/// What the attributes of a mesh cost as its edges collapse.
pub(super) struct AttributeCosts {
    /// By wedge; by vertex if there are none.
    quadrics: Vec<AttributeQuadric>,
    /// The wedges of every vertex.
    wedges: Option<Rows>,
    channels: usize,
}

/// Wedges that become one: the one that stays and the one that goes. An edge has two sides.
pub(super) type Pairs = [Option<[u32; 2]>; 2];

impl AttributeCosts {
    /// Those of `mesh`, whose normalized positions these are.
    ///
    /// # Panics
    ///
    /// If `field` is not of this mesh.
    pub fn new(mesh: &TriangleMesh, positions: &[Point], field: &AttributeField) -> Self {
        assert_eq!(field.corners.len(), mesh.face_count());
        let wedges = mesh.wedges();
        let count = wedges.map_or(mesh.vertex_count(), Wedges::count);
        let mut costs = Self {
            quadrics: vec![AttributeQuadric::NONE; count],
            wedges: wedges.map(|wedges| {
                let owned = wedges.vertices().iter().copied().zip(0..);
                Rows::from_pairs(mesh.vertex_count(), &owned.collect::<Vec<_>>())
            }),
            channels: field.channels.min(CHANNELS),
        };
        let areas: Vec<f64> = mesh
            .faces()
            .iter()
            .map(|face| area(*face, positions))
            .collect();
        let mean = areas.iter().sum::<f64>() / areas.len().max(1) as f64;
        let corners = wedges.map_or(mesh.faces(), Wedges::corners);
        for (face, (values, wedges)) in field.corners.iter().zip(corners).enumerate() {
            let triangle = mesh.faces()[face].map(|corner| positions[corner as usize]);
            let weight = areas[face] / mean;
            if let Some(of_face) = of_face(&triangle, values, (costs.channels, weight)) {
                for &wedge in wedges {
                    costs.quadrics[wedge as usize].add(&of_face);
                }
            }
        }
        costs
    }

    /// What is lost if the vertex that goes is merged into `left`, as a function of the place.
    pub fn of_merged(&self, left: u32, pairs: &Pairs) -> Quadric {
        let mut sum = [0.0; 10];
        let own = [left];
        let wedges = match &self.wedges {
            Some(wedges) => wedges.row(left as usize),
            None => &own,
        };
        for &wedge in wedges {
            let mut merged = self.quadrics[wedge as usize];
            for [_, goes] in pairs.iter().flatten().filter(|[stays, _]| *stays == wedge) {
                merged.add(&self.quadrics[*goes as usize]);
            }
            let left = merged.with_best_values(self.channels);
            sum.iter_mut()
                .zip(left)
                .for_each(|(sum, term)| *sum += term);
        }
        Quadric::from_coefficients(sum)
    }

    /// Merges wedges for good.
    pub fn merge(&mut self, pairs: &Pairs) {
        for [stays, goes] in pairs.iter().flatten() {
            let merged = self.quadrics[*goes as usize];
            self.quadrics[*stays as usize].add(&merged);
        }
    }
}

fn area(face: [u32; 3], positions: &[Point]) -> f64 {
    let [a, b, c] = face.map(|corner| positions[corner as usize]);
    (b - a).cross(&(c - a)).norm() / 2.0
}

/// How the attributes change over one face; none for a face without area.
fn of_face(
    triangle: &[Point; 3],
    values: &[[f64; CHANNELS]; 3],
    (channels, weight): (usize, f64),
) -> Option<AttributeQuadric> {
    let normal = face_normal(*triangle)?;
    let [a, b, c] = triangle;
    let (ab, ac) = (b - a, c - a);
    let double_area = ab.cross(&ac).norm();
    let (across_ac, across_ab) = (ac.cross(&normal), normal.cross(&ab));
    let mut quadric = AttributeQuadric {
        weight,
        ..AttributeQuadric::NONE
    };
    for channel in 0..channels {
        let [at_a, at_b, at_c] = values.each_ref().map(|corner| corner[channel]);
        let gradient = (across_ac * (at_b - at_a) + across_ab * (at_c - at_a)) / double_area;
        let offset = at_a - gradient.dot(&a.coords);
        let linear = [gradient.x, gradient.y, gradient.z, offset];
        quadric.linear[channel] = linear.map(|entry| entry * weight);
        for (sum, square) in quadric.squares.iter_mut().zip(squares(&linear)) {
            *sum += weight * square;
        }
    }
    let is_finite = quadric.squares.iter().all(|entry| entry.is_finite());
    is_finite.then_some(quadric)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simplification::{Options, simplify};

    const SIDE: u32 = 24;

    /// A flat sheet, one unit wide, whose grid is turned against what is painted on it.
    fn sheet() -> TriangleMesh {
        let at = |k: u32| f64::from(k) / f64::from(SIDE);
        let corners = (0..=SIDE).flat_map(|y| (0..=SIDE).map(move |x| (at(x), at(y))));
        let faces = (0..SIDE * SIDE).flat_map(|k| {
            let a = k / SIDE * (SIDE + 1) + k % SIDE;
            let [b, c, d] = [a + 1, a + SIDE + 2, a + SIDE + 1];
            [[a, b, c], [a, c, d]]
        });
        let positions = corners.map(|(x, y)| Point::new(x, y, 0.0)).collect();
        TriangleMesh::new(positions, faces.collect()).unwrap()
    }

    /// Light on one side of a line at 30 degrees and dark on the other, with a soft edge.
    fn painted(at: &Point) -> f64 {
        let beyond = (at.x - 0.5) * 0.5 + (at.y - 0.5) * 0.866;
        (beyond / 0.04).clamp(-1.0, 1.0)
    }

    fn field(mesh: &TriangleMesh, weight: f64) -> AttributeField {
        let value = |corner: &Point| {
            let mut values = [0.0; CHANNELS];
            values[0] = weight * painted(corner);
            values
        };
        AttributeField {
            corners: (0..mesh.face_count())
                .map(|face| mesh.triangle(face).each_ref().map(value))
                .collect(),
            channels: 1,
        }
    }

    /// How far what is painted is from what vertices alone say of it, at the middles of faces.
    fn error(simplified: &TriangleMesh) -> f64 {
        let of_face = |face: usize| {
            let corners = simplified.triangle(face);
            let middle = Point::from(corners.iter().map(|c| c.coords).sum::<crate::Vector>() / 3.0);
            let mean = corners.iter().map(painted).sum::<f64>() / 3.0;
            let [a, b, c] = corners;
            (b - a).cross(&(c - a)).norm() * (mean - painted(&middle)).abs()
        };
        (0..simplified.face_count()).map(of_face).sum()
    }

    #[test]
    fn vertices_stay_where_the_color_changes() {
        let mesh = sheet();
        let simplified = |weight: f64| {
            let options = Options {
                attributes: Some(field(&mesh, weight)),
                ..Options::to_faces(120)
            };
            simplify(&mesh, None, &options).mesh
        };
        let (without, with) = (error(&simplified(0.0)), error(&simplified(0.1)));
        assert!(with < 0.5 * without, "{without} {with}");
    }

    #[test]
    fn an_attribute_that_is_linear_in_the_place_costs_nothing_anywhere() {
        let mesh = sheet();
        let mut linear = field(&mesh, 0.0);
        for (face, corners) in linear.corners.iter_mut().enumerate() {
            for (values, at) in corners.iter_mut().zip(mesh.triangle(face)) {
                (values[0], values[1]) = (0.3 * at.x - 2.0 * at.y, at.y);
            }
        }
        linear.channels = 2;
        let costs = AttributeCosts::new(&mesh, mesh.positions(), &linear);
        let inner = SIDE / 2 * (SIDE + 1) + SIDE / 2;
        let pairs = [Some([inner, inner + 1]), None];
        let merged = costs.of_merged(inner, &pairs);
        for at in [Point::new(0.5, 0.5, 0.0), Point::new(2.0, -1.0, 0.0)] {
            // Moved along the gradient the best values go along: nothing tells it from staying.
            assert!(merged.cost(&at) < 1e-9, "{}", merged.cost(&at));
        }
    }

    #[test]
    fn what_is_left_is_the_sum_over_faces_with_the_best_value() {
        let triangle = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]].map(Point::from);
        let other = [[0., 0., 0.], [0., 1., 0.], [-1., 0., 0.]].map(Point::from);
        let values = |at: [f64; 3]| {
            at.map(|value| {
                let mut values = [0.0; CHANNELS];
                values[0] = value;
                values
            })
        };
        // x on one face, 0 on the other.
        let mut sum = of_face(&triangle, &values([0., 1., 0.]), (1, 1.0)).unwrap();
        sum.add(&of_face(&other, &values([0., 0., 0.]), (1, 3.0)).unwrap());
        let quadric = Quadric::from_coefficients(sum.with_best_values(1));
        // At x the faces say x and 0, weighted 1 and 3: the mean is x / 4.
        let expected = |x: f64| (x - x / 4.0).powi(2) + 3.0 * (x / 4.0).powi(2);
        for x in [0.0, 0.4, -2.0] {
            let found = quadric.cost(&Point::new(x, 0.7, 0.1));
            assert!((found - expected(x)).abs() < 1e-12, "{found}");
        }
    }
}
