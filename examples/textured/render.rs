//! Textured meshes as pictures, from around.

use image::{Rgb, RgbImage};

/// A mesh with a texture coordinate per point.
pub struct Textured {
    pub positions: Vec<[f32; 3]>,
    pub faces: Vec<[u32; 3]>,
    pub coordinates: Vec<[f32; 2]>,
}

/// Where the pictures are taken from: on a circle around the vertical axis, without perspective,
/// all in the same scale.
pub struct Views {
    center: [f32; 3],
    scale: f32,
    size: u32,
}

/// One picture, and which of its pixels show the mesh.
pub struct Picture {
    pub image: RgbImage,
    pub covered: Vec<bool>,
}

const BACKGROUND: Rgb<u8> = Rgb([255, 255, 255]);

impl Views {
    pub fn of(mesh: &Textured, size: u32) -> Self {
        let axis = |axis: usize| {
            let values = mesh.positions.iter().map(|p| p[axis]);
            let low = values.clone().fold(f32::INFINITY, f32::min);
            (low, values.fold(f32::NEG_INFINITY, f32::max))
        };
        let boxes = [axis(0), axis(1), axis(2)];
        let extent = boxes.iter().map(|(low, high)| high - low);
        Self {
            center: boxes.map(|(low, high)| (low + high) / 2.0),
            scale: size as f32 * 0.95 / extent.fold(0.0, f32::max),
            size,
        }
    }

    /// The mesh seen from a direction, 0 to 1 for once around.
    pub fn take(&self, mesh: &Textured, texture: &RgbImage, turn: f32) -> Picture {
        let (sin, cos) = (turn * std::f32::consts::TAU).sin_cos();
        let half = self.size as f32 / 2.0;
        let seen: Vec<[f32; 3]> = mesh
            .positions
            .iter()
            .map(|p| {
                let [x, y, z] = std::array::from_fn(|i| (p[i] - self.center[i]) * self.scale);
                [half + x * cos - z * sin, half - y, x * sin + z * cos]
            })
            .collect();
        let mut picture = Picture {
            image: RgbImage::from_pixel(self.size, self.size, BACKGROUND),
            covered: vec![false; (self.size * self.size) as usize],
        };
        let mut depth = vec![f32::NEG_INFINITY; picture.covered.len()];
        for face in &mesh.faces {
            let corners = face.map(|point| seen[point as usize]);
            let coordinates = face.map(|point| mesh.coordinates[point as usize]);
            picture.draw(corners, coordinates, texture, &mut depth);
        }
        picture
    }
}

impl Picture {
    fn draw(
        &mut self,
        [a, b, c]: [[f32; 3]; 3],
        coordinates: [[f32; 2]; 3],
        texture: &RgbImage,
        depth: &mut [f32],
    ) {
        let size = self.image.width();
        let range = |axis: usize| {
            let values = [a[axis], b[axis], c[axis]];
            let low = values.iter().copied().fold(f32::INFINITY, f32::min);
            let high = values.iter().copied().fold(0.0, f32::max);
            (low.max(0.0) as u32)..((high.ceil() as u32).min(size))
        };
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        if area == 0.0 {
            return;
        }
        for y in range(1) {
            for x in range(0) {
                let (px, py) = (x as f32 + 0.5, y as f32 + 0.5);
                let of = |p: [f32; 3], q: [f32; 3]| {
                    ((p[0] - px) * (q[1] - py) - (p[1] - py) * (q[0] - px)) / area
                };
                let weights = [of(b, c), of(c, a), of(a, b)];
                if weights.iter().any(|&w| w < 0.0) {
                    continue;
                }
                let z = weights[0] * a[2] + weights[1] * b[2] + weights[2] * c[2];
                let pixel = (y * size + x) as usize;
                if depth[pixel] < z {
                    depth[pixel] = z;
                    self.covered[pixel] = true;
                    let at: [f32; 2] = std::array::from_fn(|axis| {
                        (0..3).map(|i| weights[i] * coordinates[i][axis]).sum()
                    });
                    self.image.put_pixel(x, y, sample(texture, at));
                }
            }
        }
    }
}

/// Between the four nearest texels; v points up.
fn sample(texture: &RgbImage, [u, v]: [f32; 2]) -> Rgb<u8> {
    let (width, height) = texture.dimensions();
    let x = (u * width as f32 - 0.5).clamp(0.0, width as f32 - 1.0);
    let y = ((1.0 - v) * height as f32 - 0.5).clamp(0.0, height as f32 - 1.0);
    let (left, top) = (x as u32, y as u32);
    let (right, bottom) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
    let (fx, fy) = (x - left as f32, y - top as f32);
    let texel = |x, y| texture.get_pixel(x, y).0.map(f32::from);
    let corners = [
        texel(left, top),
        texel(right, top),
        texel(left, bottom),
        texel(right, bottom),
    ];
    let weights = [
        (1.0 - fx) * (1.0 - fy),
        fx * (1.0 - fy),
        (1.0 - fx) * fy,
        fx * fy,
    ];
    Rgb(std::array::from_fn(|channel| {
        let sum: f32 = (0..4).map(|i| weights[i] * corners[i][channel]).sum();
        sum.round() as u8
    }))
}

/// The sum of the squared differences of all channels where either picture shows the mesh, and
/// the number of them.
pub fn difference(a: &Picture, b: &Picture) -> (f64, usize) {
    let pixels = a.image.pixels().zip(b.image.pixels());
    let covered = a.covered.iter().zip(&b.covered).map(|(a, b)| *a || *b);
    let mut sum = (0.0, 0);
    for ((p, q), _) in pixels.zip(covered).filter(|(_, covered)| *covered) {
        for channel in 0..3 {
            let difference = f64::from(p.0[channel]) - f64::from(q.0[channel]);
            sum.0 += difference * difference;
            sum.1 += 1;
        }
    }
    sum
}
