//! Surface nets: the resting figure as a closed triangle mesh, afresh for every grid.
//!
//! One vertex for every cell that the surface passes through, one quadrilateral
//! around every crossed grid edge. The samples are made well-composed first
//! (see [`crate::topology`]), so that the quadrilaterals form a closed oriented
//! 2-manifold; a quadrilateral's diagonal joins two cells that no other
//! quadrilateral joins, so the triangles do as well.
//!
//! Source: Gibson, "Constrained Elastic Surface Nets", MICCAI 1998, without the
//! constraint to the cell and with projection onto the surface instead.

use nalgebra::Vector3;

use crate::blocks::{Blocks, CELL_CORNERS, CELL_COUNT, Grid, add, to_vector};
use crate::body::Body;
use crate::topology::{inside_corners, make_well_composed};

/// No vertex: the surface does not pass through the cell.
const NONE: u32 = u32::MAX;

/// Rounds of relaxation and projection. Tuned at 20,000 vertices: the second halves the distance
/// to the surface, to 0.03 mm on average, and evens out the edges; a third changes little.
const RELAXATIONS: usize = 2;

/// The twelve edges of a cell, as pairs of corners.
const EDGES: [[usize; 2]; 12] = [
    [0, 1],
    [2, 3],
    [4, 5],
    [6, 7],
    [0, 2],
    [1, 3],
    [4, 6],
    [5, 7],
    [0, 4],
    [1, 5],
    [2, 6],
    [3, 7],
];

/// A mesh of the resting figure.
#[derive(Debug, Clone)]
pub(crate) struct Surface {
    /// On the surface.
    pub(crate) positions: Vec<Vector3<f64>>,
    /// Outward unit normals, those of the figure without folds.
    pub(crate) normals: Vec<Vector3<f64>>,
    /// Counter-clockwise seen from outside.
    pub(crate) faces: Vec<[u32; 3]>,
}

/// A surface net before it is drawn onto the surface.
#[derive(Debug)]
pub(crate) struct Net<'a> {
    body: &'a Body,
    spacing: f64,
    samples: Blocks<'a>,
    positions: Vec<Vector3<f64>>,
    /// The block of each vertex.
    blocks: Vec<u32>,
    /// The vertex of each cell of each block, or [`NONE`].
    vertices: Vec<[u32; CELL_COUNT]>,
}

impl<'a> Net<'a> {
    /// Finds the cells that the surface of `body` passes through.
    pub(crate) fn new(body: &'a Body, grid: &'a Grid) -> Self {
        let mut samples = Blocks::sample(body, grid);
        make_well_composed(&mut samples);
        let mut positions = Vec::new();
        let mut blocks = Vec::new();
        let mut vertices = vec![[NONE; CELL_COUNT]; samples.blocks.len()];
        for (index, block) in samples.blocks.iter().enumerate() {
            for (cell, vertex) in vertices[index].iter_mut().enumerate() {
                let values = block.cell_values(cell);
                if !matches!(inside_corners(&values), 0 | 255) {
                    *vertex = positions.len() as u32;
                    let in_grid = to_vector(block.cell(cell)) + mean_crossing(&values);
                    positions.push(grid.to_rest(in_grid));
                    blocks.push(index as u32);
                }
            }
        }
        Self {
            body,
            spacing: grid.spacing,
            samples,
            positions,
            blocks,
            vertices,
        }
    }

    /// How many vertices the mesh will have.
    pub(crate) fn vertex_count(&self) -> usize {
        self.positions.len()
    }

    /// Draws the net onto the surface and evens it out.
    pub(crate) fn into_surface(mut self) -> Surface {
        let quads = self.quads();
        let mut normals = vec![Vector3::zeros(); self.positions.len()];
        for _ in 0..RELAXATIONS {
            self.relax(&quads);
            for (vertex, normal) in normals.iter_mut().enumerate() {
                let parts = &self.samples.blocks[self.blocks[vertex] as usize].parts;
                let position = &mut self.positions[vertex];
                *normal = project(self.body, parts, self.spacing, position);
            }
        }
        let faces = quads
            .iter()
            .flat_map(|&quad| triangulate(&self.positions, quad))
            .collect();
        Surface {
            positions: self.positions,
            normals,
            faces,
        }
    }

    /// One quadrilateral around every crossed edge, counter-clockwise seen from outside.
    fn quads(&self) -> Vec<[u32; 4]> {
        // Two vertices fewer than the figure without handles has; a handle adds two.
        let mut quads = Vec::with_capacity(self.positions.len());
        for (index, block) in self.samples.blocks.iter().enumerate() {
            for cell in 0..CELL_COUNT {
                if self.vertices[index][cell] == NONE {
                    continue;
                }
                let inside = inside_corners(&block.cell_values(cell));
                for axis in 0..3 {
                    let (start, end) = (inside & 1 != 0, inside >> (1 << axis) & 1 != 0);
                    if start != end {
                        let quad = self.quad_around(index, block.cell(cell), axis);
                        quads.push(if start {
                            quad
                        } else {
                            [quad[0], quad[3], quad[2], quad[1]]
                        });
                    }
                }
            }
        }
        quads
    }

    /// The vertices of the four cells around the edge from the first corner of `cell` along `axis`.
    ///
    /// The cell is in `block`. They run counter-clockwise seen from the end of the edge.
    fn quad_around(&self, block: usize, cell: [i32; 3], axis: usize) -> [u32; 4] {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        [[0, 0], [-1, 0], [-1, -1], [0, -1]].map(|[along_u, along_v]| {
            let mut step = [0; 3];
            step[u] = along_u;
            step[v] = along_v;
            let (block, in_block) = self
                .samples
                .find_cell_near(block, add(cell, step))
                .expect("a cell with a crossed edge contains the surface, so its block is kept");
            self.vertices[block][in_block]
        })
    }

    /// Moves every vertex half-way to the mean of its neighbours.
    fn relax(&mut self, quads: &[[u32; 4]]) {
        let mut sums = vec![(Vector3::zeros(), 0.0); self.positions.len()];
        for quad in quads {
            let corners = quad.map(|vertex| self.positions[vertex as usize]);
            for i in 0..4 {
                let sum = &mut sums[quad[i] as usize];
                sum.0 += corners[(i + 1) % 4] + corners[(i + 3) % 4];
                sum.1 += 2.0;
            }
        }
        for (position, (sum, count)) in self.positions.iter_mut().zip(sums) {
            *position = (*position + sum / count) * 0.5;
        }
    }
}

/// The mean of the points where the surface crosses the edges of a cell, in cell coordinates.
fn mean_crossing(values: &[f32; 8]) -> Vector3<f64> {
    let mut sum = Vector3::zeros();
    let mut count = 0.0;
    for [a, b] in EDGES {
        let (from, to) = (f64::from(values[a]), f64::from(values[b]));
        if (from < 0.0) != (to < 0.0) {
            let start = to_vector(CELL_CORNERS[a]);
            sum += start + (to_vector(CELL_CORNERS[b]) - start) * (from / (from - to));
            count += 1.0;
        }
    }
    sum / count
}

/// One Newton step onto the surface, by at most one cell; returns the normal.
fn project(body: &Body, parts: &[u16], spacing: f64, position: &mut Vector3<f64>) -> Vector3<f64> {
    let (distance, gradient) = body.distance_and_gradient(parts, *position);
    let length = gradient.norm();
    if length < 1e-6 {
        // On the axis of a part that is thinner than the grid there is no way out to prefer.
        return Vector3::y();
    }
    let normal = gradient / length;
    *position -= normal * (distance / length).clamp(-spacing, spacing);
    normal
}

/// Cuts a quadrilateral along the diagonal that gives the better triangles.
fn triangulate(positions: &[Vector3<f64>], [a, b, c, d]: [u32; 4]) -> [[u32; 3]; 2] {
    let one = [[a, b, c], [a, c, d]];
    let other = [[b, c, d], [b, d, a]];
    if worst_shape(positions, one) >= worst_shape(positions, other) {
        one
    } else {
        other
    }
}

/// The lower shape quality of two triangles that share an edge, negative if they fold over.
fn worst_shape(positions: &[Vector3<f64>], triangles: [[u32; 3]; 2]) -> f64 {
    let [first, second] = triangles.map(|triangle| {
        let [a, b, c] = triangle.map(|vertex| positions[vertex as usize]);
        let edges = (b - a).norm_squared() + (c - b).norm_squared() + (a - c).norm_squared();
        (b - a).cross(&(c - a)) / edges.max(f64::MIN_POSITIVE)
    });
    let shape = first.norm_squared().min(second.norm_squared());
    if first.dot(&second) < 0.0 {
        -shape
    } else {
        shape
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix3;

    use super::*;

    #[test]
    fn vertices_lie_on_the_figure_to_a_small_fraction_of_a_cell() {
        let body = Body::new();
        let (center, _) = body.bounding_ball();
        let (rotation, offset) = (Matrix3::identity(), Vector3::repeat(0.3));
        let grid = Grid {
            spacing: 0.012,
            rotation,
            offset,
            center,
        };
        let surface = Net::new(&body, &grid).into_surface();
        let all = body.all_parts();
        let squares = surface.positions.iter().map(|&position| {
            let (distance, gradient) = body.distance_and_gradient(&all, position);
            (distance / gradient.norm()).powi(2)
        });
        let root_mean_square = (squares.sum::<f64>() / surface.positions.len() as f64).sqrt();
        assert!(root_mean_square < 0.01 * grid.spacing, "{root_mean_square}");
    }
}
