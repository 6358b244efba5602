//! Solids that move, meshed anew in every frame, with their true motion known.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Point3, Rotation3, Vector3};

pub type Point = Point3<f64>;

/// A segment with a radius, where it rests.
#[derive(Clone, Copy)]
pub struct Capsule {
    pub ends: [Point; 2],
    pub radius: f64,
}

impl Capsule {
    fn distance(&self, point: &Point) -> f64 {
        let [a, b] = self.ends;
        let along = b - a;
        let t = (point - a).dot(&along) / along.norm_squared();
        (point - (a + along * t.clamp(0.0, 1.0))).norm() - self.radius
    }
}

/// Parts that each move rigidly; where they overlap they are one solid.
#[derive(Clone)]
pub struct Solid {
    pub parts: Vec<(Capsule, Isometry3<f64>)>,
}

/// A mesh, and the part that each vertex is on.
pub struct Meshed {
    pub positions: Vec<Point>,
    pub faces: Vec<[u32; 3]>,
    pub parts: Vec<usize>,
}

impl Solid {
    fn distances(&self, point: &Point) -> impl Iterator<Item = f64> {
        let parts = self.parts.iter();
        parts.map(move |(capsule, posed)| capsule.distance(&(posed.inverse() * point)))
    }

    fn distance(&self, point: &Point) -> f64 {
        self.distances(point).fold(f64::INFINITY, f64::min)
    }

    fn part_at(&self, point: &Point) -> usize {
        let distances: Vec<f64> = self.distances(point).collect();
        let nearest = |a: &usize, b: &usize| distances[*a].total_cmp(&distances[*b]);
        (0..distances.len()).min_by(nearest).unwrap()
    }

    /// Where the true motion from here to `later` takes a point of a part.
    pub fn carry(&self, later: &Self, point: &Point, part: usize) -> Point {
        later.parts[part].1 * (self.parts[part].1.inverse() * point)
    }

    /// Marching tetrahedra in the box from −`half` to `half`, on a grid that `seed` turns and
    /// shifts, so that no two seeds share a vertex.
    pub fn mesh(&self, half: f64, step: f64, seed: f64) -> Meshed {
        let turn = Rotation3::from_euler_angles(0.3 + seed, 1.1 * seed, 0.7 - seed);
        let shift = Vector3::new(0.31, 0.57, 0.83) * (seed * step);
        let count = (2.0 * 1.75 * half / step).ceil() as i32;
        let at = |[i, j, k]: [i32; 3]| {
            let middle = 0.5 * f64::from(count);
            let cell = Vector3::new(f64::from(i), f64::from(j), f64::from(k));
            turn * Point::from((cell - Vector3::repeat(middle)) * step + shift)
        };
        let side = count as usize + 1;
        let index = |[i, j, k]: [i32; 3]| (i as usize * side + j as usize) * side + k as usize;
        let mut values = vec![0.0; side * side * side];
        each_cell(count + 1, |corner| {
            values[index(corner)] = self.distance(&at(corner));
        });
        let mut marching = Marching::default();
        each_cell(count, |cell| {
            for tetrahedron in tetrahedra(cell) {
                let corners = tetrahedron.map(|c| (index(c), at(c), values[index(c)]));
                marching.cut(&corners);
            }
        });
        let parts = marching.positions.iter().map(|p| self.part_at(p)).collect();
        Meshed {
            positions: marching.positions,
            faces: marching.faces,
            parts,
        }
    }
}

fn each_cell(count: i32, mut visit: impl FnMut([i32; 3])) {
    for i in 0..count {
        for j in 0..count {
            (0..count).for_each(|k| visit([i, j, k]));
        }
    }
}

/// The six tetrahedra around a cell's diagonal (Kuhn), the same on both sides of every face.
fn tetrahedra([i, j, k]: [i32; 3]) -> impl Iterator<Item = [[i32; 3]; 4]> {
    let orders = [
        [0, 1, 2],
        [1, 2, 0],
        [2, 0, 1],
        [0, 2, 1],
        [2, 1, 0],
        [1, 0, 2],
    ];
    orders.into_iter().map(move |order| {
        let mut corners = [[i, j, k]; 4];
        for (step, axis) in order.into_iter().enumerate() {
            for corner in &mut corners[step + 1..] {
                corner[axis] += 1;
            }
        }
        corners
    })
}

#[derive(Default)]
struct Marching {
    positions: Vec<Point>,
    faces: Vec<[u32; 3]>,
    on_edges: BTreeMap<(usize, usize), u32>,
}

type Corner = (usize, Point, f64);

impl Marching {
    /// Adds what of the surface is in a tetrahedron.
    fn cut(&mut self, corners: &[Corner; 4]) {
        let (inside, outside): (Vec<Corner>, Vec<Corner>) =
            corners.iter().partition(|corner| corner.2 < 0.0);
        let polygon: Vec<u32> = match (inside.len(), outside.len()) {
            (1, 3) => (0..3).map(|o| self.vertex(inside[0], outside[o])).collect(),
            (3, 1) => (0..3).map(|i| self.vertex(inside[i], outside[0])).collect(),
            (2, 2) => [(0, 0), (0, 1), (1, 1), (1, 0)]
                .map(|(i, o)| self.vertex(inside[i], outside[o]))
                .to_vec(),
            _ => return,
        };
        let outwards = outside[0].1 - inside[0].1;
        for last in 2..polygon.len() {
            let mut face = [polygon[0], polygon[last - 1], polygon[last]];
            let [a, b, c] = face.map(|v| self.positions[v as usize]);
            if (b - a).cross(&(c - a)).dot(&outwards) < 0.0 {
                face.swap(1, 2);
            }
            self.faces.push(face);
        }
    }

    fn vertex(&mut self, a: Corner, b: Corner) -> u32 {
        let positions = &mut self.positions;
        let key = (a.0.min(b.0), a.0.max(b.0));
        *self.on_edges.entry(key).or_insert_with(|| {
            // Not too close to a corner: slivers would be no fair surface.
            let share = (a.2 / (a.2 - b.2)).clamp(0.1, 0.9);
            positions.push(a.1 + (b.1 - a.1) * share);
            positions.len() as u32 - 1
        })
    }
}
