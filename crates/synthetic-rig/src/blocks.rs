//! Samples of the figure's field on a turned grid, kept only near the surface.
//!
//! Space is divided into blocks of 4³ cells. An octree descends only where the
//! field is smaller than the distance to the corners of the node, so empty
//! space costs nothing; on its way down it narrows the list of body parts that
//! can matter. Blocks hold all 5³ corner samples of their cells, those that
//! they share with their neighbours included.

use nalgebra::{Matrix3, Vector3};

use crate::body::{Body, MAX_DISPLACEMENT, Parts};

/// Cells along the edge of a block.
const CELLS: i32 = 4;
/// Corners along the edge of a block.
const CORNERS: i32 = CELLS + 1;
/// Corners of a block.
const CORNER_COUNT: usize = (CORNERS * CORNERS * CORNERS) as usize;
/// Cells of a block.
pub(crate) const CELL_COUNT: usize = (CELLS * CELLS * CELLS) as usize;

/// More than single precision rounds off a sample, in metres.
const ROUNDING: f64 = 5e-6;

/// The eight corners of a cell; bit 0 of the index is x, bit 1 is y, bit 2 is z.
pub(crate) const CELL_CORNERS: [[i32; 3]; 8] = [
    [0, 0, 0],
    [1, 0, 0],
    [0, 1, 0],
    [1, 1, 0],
    [0, 0, 1],
    [1, 0, 1],
    [0, 1, 1],
    [1, 1, 1],
];

/// The placement of the sampling grid in the space of the resting figure.
#[derive(Debug, Clone)]
pub(crate) struct Grid {
    /// The edge of a cell, in metres.
    pub(crate) spacing: f64,
    /// Turns grid axes into those of the figure.
    pub(crate) rotation: Matrix3<f64>,
    /// Where the figure's centre lies in its cell, each 0 to 1.
    pub(crate) offset: Vector3<f64>,
    /// The centre of the figure.
    pub(crate) center: Vector3<f64>,
}

impl Grid {
    /// The point of the figure's space at grid coordinates `point`.
    pub(crate) fn to_rest(&self, point: Vector3<f64>) -> Vector3<f64> {
        self.center + self.rotation * ((point - self.offset) * self.spacing)
    }
}

/// 4³ cells near the surface.
#[derive(Debug, Clone)]
pub(crate) struct Block {
    /// The grid coordinates of the first corner.
    pub(crate) min: [i32; 3],
    /// The body parts that can matter in the block and one cell around it.
    pub(crate) parts: Parts,
    values: [f32; CORNER_COUNT],
}

impl Block {
    /// The grid coordinates of the cell with index `cell` (0 to 63).
    pub(crate) fn cell(&self, cell: usize) -> [i32; 3] {
        let cell = cell as i32;
        add(
            self.min,
            [cell % CELLS, cell / CELLS % CELLS, cell / (CELLS * CELLS)],
        )
    }

    /// The field at the corners of the cell with index `cell`, in the order of [`CELL_CORNERS`].
    #[inline]
    pub(crate) fn cell_values(&self, cell: usize) -> [f32; 8] {
        const Y: usize = CORNERS as usize;
        const Z: usize = Y * Y;
        let first = cell % 4 + cell / 4 % 4 * Y + cell / 16 * Z;
        let v = &self.values[first..first + Z + Y + 2];
        [
            v[0],
            v[1],
            v[Y],
            v[Y + 1],
            v[Z],
            v[Z + 1],
            v[Z + Y],
            v[Z + Y + 1],
        ]
    }

    fn set_corner(&mut self, corner: [i32; 3], value: f32) {
        let local = [0, 1, 2].map(|axis| corner[axis] - self.min[axis]);
        let index = local[0] + CORNERS * (local[1] + CORNERS * local[2]);
        self.values[index as usize] = value;
    }
}

/// All blocks near the surface.
#[derive(Debug, Clone)]
pub(crate) struct Blocks<'a> {
    body: &'a Body,
    grid: &'a Grid,
    /// In the order of discovery, which is spatially coherent.
    pub(crate) blocks: Vec<Block>,
    /// Block corners and indices, sorted for look-up.
    index: Vec<([i32; 3], u32)>,
}

impl<'a> Blocks<'a> {
    /// Samples `body` on `grid`.
    pub(crate) fn sample(body: &'a Body, grid: &'a Grid) -> Self {
        let mut blocks = Self {
            body,
            grid,
            blocks: Vec::new(),
            index: Vec::new(),
        };
        let (_, radius) = body.bounding_ball();
        // One cell more on each side for the offset of the grid.
        let reach = (radius / grid.spacing).ceil() as i32 + 2;
        let mut half = CELLS;
        while half < reach {
            half *= 2;
        }
        blocks.visit([-half; 3], 2 * half, &body.all_parts());
        blocks.index = blocks
            .blocks
            .iter()
            .zip(0_u32..)
            .map(|(block, index)| (block.min, index))
            .collect();
        blocks.index.sort_unstable();
        blocks
    }

    /// The index of the block that holds the cell at grid coordinates `cell`, and the cell's in it.
    pub(crate) fn find_cell(&self, cell: [i32; 3]) -> Option<(usize, usize)> {
        let (min, in_block) = split(cell);
        let found = self
            .index
            .binary_search_by_key(&min, |&(min, _)| min)
            .ok()?;
        Some((self.index[found].1 as usize, in_block))
    }

    /// Like [`Self::find_cell`], faster if the cell is in the block with index `block`.
    pub(crate) fn find_cell_near(&self, block: usize, cell: [i32; 3]) -> Option<(usize, usize)> {
        let (min, in_block) = split(cell);
        if self.blocks[block].min == min {
            Some((block, in_block))
        } else {
            self.find_cell(cell)
        }
    }

    /// Like [`Self::find_cell`], but samples the block if it was thought to be empty.
    pub(crate) fn require_cell(&mut self, cell: [i32; 3]) -> (usize, usize) {
        if let Some(found) = self.find_cell(cell) {
            return found;
        }
        let (min, in_block) = split(cell);
        let parts = self.body.all_parts();
        self.push_block(min, parts);
        let block = self.blocks.len() - 1;
        let position = self.index.partition_point(|&(other, _)| other < min);
        self.index.insert(position, (min, block as u32));
        (block, in_block)
    }

    /// Sets the field at a corner, in every block that shares it.
    pub(crate) fn set_corner(&mut self, corner: [i32; 3], value: f32) {
        for cell in cells_around(corner) {
            let (block, _) = self.require_cell(cell);
            self.blocks[block].set_corner(corner, value);
        }
    }

    /// Descends into the cube of `size` cells at `min` if the surface may pass through it.
    fn visit(&mut self, min: [i32; 3], size: i32, candidates: &[u16]) {
        let half = f64::from(size) / 2.0;
        let center = self.grid.to_rest(to_vector(min) + Vector3::repeat(half));
        let radius = half * 3.0_f64.sqrt() * self.grid.spacing;
        let (distance, distances) = self.body.smooth_distance(candidates, center);
        if distance.abs() > radius + MAX_DISPLACEMENT + ROUNDING {
            return;
        }
        let reach = radius + self.grid.spacing;
        let parts = self.body.parts_near(candidates, &distances, reach);
        if size == CELLS {
            self.push_block(min, parts);
            return;
        }
        for corner in CELL_CORNERS {
            self.visit(add(min, corner.map(|c| c * size / 2)), size / 2, &parts);
        }
    }

    fn push_block(&mut self, min: [i32; 3], parts: Parts) {
        let axes = self.grid.rotation * self.grid.spacing;
        let (x, y, z) = (axes.column(0), axes.column(1), axes.column(2));
        let mut points = [[0.0; CORNER_COUNT]; 3];
        let mut index = 0;
        // From the corner's own coordinates, so that all blocks sharing it agree to the bit.
        let local = [0, 1, 2]
            .map(|axis| [0, 1, 2, 3, 4].map(|i| f64::from(min[axis] + i) - self.grid.offset[axis]));
        for k in local[2] {
            for j in local[1] {
                for i in local[0] {
                    let point = self.grid.center + (x * i + y * j + z * k);
                    for axis in 0..3 {
                        points[axis][index] = point[axis] as f32;
                    }
                    index += 1;
                }
            }
        }
        let values = self.body.sample(&parts, &points);
        self.blocks.push(Block { min, parts, values });
    }
}

/// The eight cells that share a corner.
pub(crate) fn cells_around(corner: [i32; 3]) -> [[i32; 3]; 8] {
    CELL_CORNERS.map(|c| [0, 1, 2].map(|axis| corner[axis] - c[axis]))
}

/// The sum of two grid coordinates.
pub(crate) fn add(a: [i32; 3], b: [i32; 3]) -> [i32; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// Grid coordinates as a vector.
pub(crate) fn to_vector(point: [i32; 3]) -> Vector3<f64> {
    Vector3::from(point.map(f64::from))
}

/// The first corner of the block that holds `cell`, and the cell's index in it.
fn split(cell: [i32; 3]) -> ([i32; 3], usize) {
    let local = cell.map(|c| c.rem_euclid(CELLS));
    let min = [0, 1, 2].map(|axis| cell[axis] - local[axis]);
    (
        min,
        (local[0] + CELLS * (local[1] + CELLS * local[2])) as usize,
    )
}
