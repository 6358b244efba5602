//! The rig: a figure, its motion, and a camera that meshes it anew in every frame.

use nalgebra::{Matrix3, Vector3};

use crate::animation::{self, PERIOD_SECS};
use crate::blocks::Grid;
use crate::body::Body;
use crate::noise::{Purpose, Randomness};
use crate::polygonize::{Net, Surface};
use crate::skeleton::{Affine, Pose, Skeleton, blend};

/// The fewest vertices that still show a figure.
pub const MIN_VERTEX_COUNT: usize = 1_000;
/// The most vertices a frame may be asked to have.
pub const MAX_VERTEX_COUNT: usize = 500_000;
/// The greatest noise that leaves a surface to speak of, in metres.
pub const MAX_NOISE: f64 = 0.02;

/// What the rig captures, and how well.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Vertices in a frame, met within 5 %: [`MIN_VERTEX_COUNT`] to [`MAX_VERTEX_COUNT`].
    ///
    /// A frame has about twice as many faces.
    pub vertex_count: usize,
    /// Frames captured in a second, above 0.
    pub frames_per_second: f64,
    /// How fast the figure moves: 1 is natural, 0 stands still.
    pub speed: f64,
    /// Standard deviation of the depth noise, in metres, 0 to [`MAX_NOISE`].
    ///
    /// White and Gaussian: every vertex is moved along its normal on its own.
    pub noise: f64,
    /// Selects the meshing and the noise; the motion is always the same.
    pub seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            vertex_count: 20_000,
            frames_per_second: 30.0,
            speed: 1.0,
            noise: 0.0003,
            seed: 1,
        }
    }
}

/// Why a rig cannot be set up.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum OptionsError {
    /// Too few or too many vertices.
    #[error("{0} vertices in a frame, must be {MIN_VERTEX_COUNT} to {MAX_VERTEX_COUNT}")]
    VertexCount(usize),
    /// Not a frame rate.
    #[error("{0} frames per second, must be a finite number above 0")]
    FramesPerSecond(f64),
    /// Not a speed.
    #[error("speed {0}, must be a finite number of at least 0")]
    Speed(f64),
    /// Not a standard deviation, or more than the figure survives.
    #[error("noise of {0} m, must be 0 to {MAX_NOISE} m")]
    Noise(f64),
}

/// One captured frame: a closed, oriented 2-manifold triangle mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Where the vertices were measured, in metres, noise included.
    pub positions: Vec<[f32; 3]>,
    /// Vertex indices, counter-clockwise seen from outside.
    pub faces: Vec<[u32; 3]>,
    /// The material point of each vertex: its place on the resting figure, without noise.
    ///
    /// The same material point has the same coordinates in every frame.
    pub rest: Vec<[f64; 3]>,
}

impl Frame {
    /// The material point at `barycentric` coordinates of a face, `None` if there is no such face.
    #[must_use]
    pub fn rest_at(&self, face: usize, barycentric: [f64; 3]) -> Option<[f64; 3]> {
        let corners = self
            .faces
            .get(face)?
            .map(|vertex| self.rest.get(vertex as usize));
        let mut sum = [0.0; 3];
        for (corner, weight) in corners.into_iter().zip(barycentric) {
            for (total, coordinate) in sum.iter_mut().zip(corner?) {
                *total += weight * coordinate;
            }
        }
        Some(sum)
    }
}

/// A synthetic capture rig. Equal options give equal frames, to the bit.
#[derive(Debug, Clone)]
pub struct Rig {
    options: Options,
    body: Body,
    skeleton: Skeleton,
    period_frames: u64,
    /// Face areas times face normals of the resting figure, in m².
    area_vectors: Vec<Vector3<f64>>,
}

impl Rig {
    /// Sets up a rig; takes about as long as one frame.
    ///
    /// # Errors
    ///
    /// [`OptionsError`] names the option that is out of its range.
    pub fn new(options: &Options) -> Result<Self, OptionsError> {
        check(options)?;
        let body = Body::new();
        let area_vectors = area_vectors(&body);
        Ok(Self {
            options: options.clone(),
            body,
            skeleton: Skeleton::new(),
            period_frames: period_frames(options),
            area_vectors,
        })
    }

    /// After how many frames the pose repeats (the meshing and the noise do not), at least 1.
    ///
    /// The loop of 4 s is stretched or shortened to a whole number of frames.
    #[must_use]
    pub fn period_frames(&self) -> u64 {
        self.period_frames
    }

    /// Captures frame `index`.
    #[must_use]
    pub fn frame(&self, index: u64) -> Frame {
        let surface = self.mesh(index);
        let pose = self.pose(index);
        let noise = Randomness::new(self.options.seed, index, Purpose::SensorNoise);
        let mut positions = Vec::with_capacity(surface.positions.len());
        let pairs = surface.positions.chunks(2).zip(surface.normals.chunks(2));
        for (pair, (points, normals)) in (0_u64..).zip(pairs) {
            let deviates = noise.gaussian_pair(pair);
            for ((&point, normal), deviate) in points.iter().zip(normals).zip(deviates) {
                let posed_from_rest = self.posed_from_rest(&pose, point);
                let along_normal = posed_normal(&posed_from_rest, normal);
                let measured =
                    posed_from_rest.apply(point) + along_normal * (deviate * self.options.noise);
                positions.push(measured.map(|coordinate| coordinate as f32).into());
            }
        }
        let rest = surface.positions.into_iter().map(Into::into).collect();
        Frame {
            positions,
            faces: surface.faces,
            rest,
        }
    }

    /// Where the material points `rest` (see [`Frame::rest`]) are in frame `index`, in metres.
    #[must_use]
    pub fn move_to(&self, rest: &[[f64; 3]], index: u64) -> Vec<[f64; 3]> {
        let pose = self.pose(index);
        let moved = |&rest: &[f64; 3]| {
            let rest = Vector3::from(rest);
            self.posed_from_rest(&pose, rest).apply(rest).into()
        };
        rest.iter().map(moved).collect()
    }

    /// Carries `points[i]`, near the figure in frame `from`, along the true motion to frame `to`.
    ///
    /// `rest[i]` is the material point that it clings to, as from [`Frame::rest_at`] for the
    /// nearest place on the mesh. A point off the surface, through noise or simplification, keeps
    /// its place in the material point's own frame. The slices are read pairwise, as far as the
    /// shorter one goes.
    #[must_use]
    pub fn carry(
        &self,
        points: &[[f64; 3]],
        rest: &[[f64; 3]],
        from: u64,
        to: u64,
    ) -> Vec<[f64; 3]> {
        let (from, to) = (self.pose(from), self.pose(to));
        let carried = |(&point, &rest): (&[f64; 3], &[f64; 3])| {
            let rest = Vector3::from(rest);
            let from = self.posed_from_rest(&from, rest);
            let to = self.posed_from_rest(&to, rest);
            let offset = Vector3::from(point) - from.apply(rest);
            let turn = to.linear * from.linear.try_inverse().unwrap_or_else(Matrix3::identity);
            (to.apply(rest) + turn * offset).into()
        };
        points.iter().zip(rest).map(carried).collect()
    }

    fn pose(&self, index: u64) -> Pose {
        let phase = (index % self.period_frames) as f64 / self.period_frames as f64;
        animation::pose(&self.skeleton, phase)
    }

    fn posed_from_rest(&self, pose: &Pose, rest: Vector3<f64>) -> Affine {
        blend(pose, &self.skeleton.weights(rest))
    }

    /// Meshes the resting figure on the grid of frame `index`.
    fn mesh(&self, index: u64) -> Surface {
        // The expectation below is met within 1 % unless the grid is very coarse.
        const TOLERANCE: f64 = 0.02;
        const ATTEMPTS: usize = 8;
        let seed = self.options.seed;
        let rotation = Randomness::new(seed, index, Purpose::GridRotation).rotation();
        let target = self.options.vertex_count as f64;
        let mut grid = Grid {
            spacing: (self.crossings(&rotation) / target).sqrt(),
            rotation,
            offset: Randomness::new(seed, index, Purpose::GridOffset).unit_cube(),
            center: self.body.bounding_ball().0,
        };
        for _ in 1..ATTEMPTS {
            let net = Net::new(&self.body, &grid);
            let ratio = net.vertex_count() as f64 / target;
            if (ratio - 1.0).abs() <= TOLERANCE {
                return net.into_surface();
            }
            grid.spacing *= ratio.sqrt();
        }
        Net::new(&self.body, &grid).into_surface()
    }

    /// How many edges of a grid of spacing 1 m the surface crosses on average, at this orientation.
    ///
    /// A face of area A and normal n crosses A |n·u| of the edges along the grid axis u. Every
    /// crossed edge has a quadrilateral, and a closed mesh of quadrilaterals has as many vertices
    /// as faces but for twice the number of pieces less handles, so this is the vertex count too.
    fn crossings(&self, rotation: &Matrix3<f64>) -> f64 {
        let axes = rotation.transpose();
        self.area_vectors
            .iter()
            .map(|area| (axes * area).lp_norm(1))
            .sum()
    }
}

fn check(options: &Options) -> Result<(), OptionsError> {
    let Options {
        vertex_count,
        frames_per_second,
        speed,
        noise,
        seed: _,
    } = *options;
    if !(MIN_VERTEX_COUNT..=MAX_VERTEX_COUNT).contains(&vertex_count) {
        return Err(OptionsError::VertexCount(vertex_count));
    }
    if !(frames_per_second.is_finite() && frames_per_second > 0.0) {
        return Err(OptionsError::FramesPerSecond(frames_per_second));
    }
    if !(speed.is_finite() && speed >= 0.0) {
        return Err(OptionsError::Speed(speed));
    }
    if !(0.0..=MAX_NOISE).contains(&noise) {
        return Err(OptionsError::Noise(noise));
    }
    Ok(())
}

fn period_frames(options: &Options) -> u64 {
    if options.speed == 0.0 {
        return 1;
    }
    // The cast saturates; 2^53 keeps phases exact for absurdly slow motions.
    let frames = (PERIOD_SECS * options.frames_per_second / options.speed).round();
    (frames as u64).clamp(1, 1 << 53)
}

/// Measures the resting figure on a grid fine enough for its folds.
fn area_vectors(body: &Body) -> Vec<Vector3<f64>> {
    const SPACING: f64 = 0.012;
    let grid = Grid {
        spacing: SPACING,
        rotation: Matrix3::identity(),
        offset: Vector3::repeat(0.5),
        center: body.bounding_ball().0,
    };
    let surface = Net::new(body, &grid).into_surface();
    let area_vector = |face: &[u32; 3]| {
        let [a, b, c] = face.map(|vertex| surface.positions[vertex as usize]);
        (b - a).cross(&(c - a)) * 0.5
    };
    surface.faces.iter().map(area_vector).collect()
}

/// The unit normal after `posed_from_rest`: normals go by the matrix of cofactors.
fn posed_normal(posed_from_rest: &Affine, normal: &Vector3<f64>) -> Vector3<f64> {
    let [x, y, z] = [0, 1, 2].map(|column| posed_from_rest.linear.column(column).into_owned());
    let turned = y.cross(&z) * normal.x + z.cross(&x) * normal.y + x.cross(&y) * normal.z;
    turned.try_normalize(1e-12).unwrap_or(*normal)
}
