//! How far the colors of vertices are from the original's, with and without a weight.

use image::RgbImage;
use steadymesh::pipeline::{
    AttributeWeight, Attributes, PreparedFrame, RawFrame, Settings, TargetSize, process,
};
use steadymesh_draco::DecodeLimits;
use steadymesh_geometry::spatial::{TriangleTree, barycentric};
use steadymesh_geometry::{Point, TriangleMesh};
use steadymesh_mesh_io::Mesh;

use crate::Textured;

const WEIGHTS: [f64; 4] = [0.0, 0.003, 0.01, 0.03];

/// Gives every point of a textured frame the color of its texel, takes the texture away, and prints
/// how well the colors survive.
pub fn report(
    name: &str,
    (mesh, original): (&Mesh, &Textured),
    texture: &RgbImage,
    target: usize,
) -> anyhow::Result<()> {
    let colors: Vec<[u8; 4]> = original
        .coordinates
        .iter()
        .map(|&[u, v]| texel(texture, u, v))
        .collect();
    for weight in WEIGHTS {
        let bare = Mesh {
            texture_coordinates: None,
            ..mesh.clone()
        };
        let mut raw = RawFrame::from_mesh(bare, 0);
        raw.positions = original
            .positions
            .iter()
            .map(|p| p.map(f64::from))
            .collect();
        raw.faces.clone_from(&original.faces);
        raw.attributes = Attributes {
            colors: Some(colors.clone()),
            ..Attributes::default()
        };
        let settings = Settings {
            target: TargetSize::Faces(target),
            attribute_weight: AttributeWeight::new(weight)?,
            ..Settings::default()
        };
        let frame = PreparedFrame::new(raw, &mut ())?;
        let processed = process(&frame, None, &settings, &mut ())?;
        let distances = processed.metrics.current_to_output;
        let distance = distances.map_or(0.0, |found| found.rmse) / processed.metrics.bbox_diagonal;
        println!(
            "| {name} | {weight} | {:.1} | {:.3} |",
            error(original, &colors, &processed.draco)?,
            100.0 * distance
        );
    }
    Ok(())
}

fn texel(texture: &RgbImage, u: f32, v: f32) -> [u8; 4] {
    let (width, height) = texture.dimensions();
    let x = (u * width as f32).clamp(0.0, (width - 1) as f32) as u32;
    let y = ((1.0 - v) * height as f32).clamp(0.0, (height - 1) as f32) as u32;
    let [red, green, blue] = texture.get_pixel(x, y).0;
    [red, green, blue, 255]
}

/// The root mean square, over the original's points and three channels, in 255ths.
fn error(original: &Textured, colors: &[[u8; 4]], draco: &[u8]) -> anyhow::Result<f64> {
    let limits = DecodeLimits {
        max_vertices: usize::MAX,
        max_faces: usize::MAX,
        max_memory_bytes: usize::MAX,
    };
    let delivered = steadymesh_draco::decode(draco, &limits)?;
    let shown = delivered.colors.unwrap_or_default();
    let positions = delivered.positions.iter();
    let positions = positions.map(|p| Point::from(p.map(f64::from))).collect();
    let surface = TriangleMesh::new(positions, delivered.faces)?;
    let Some(tree) = TriangleTree::new(&surface) else {
        anyhow::bail!("nothing was delivered");
    };
    let mut sum = 0.0;
    for (position, color) in original.positions.iter().zip(colors) {
        let below = tree.closest(&Point::from(position.map(f64::from)));
        let corners = surface.faces()[below.face as usize];
        let weights = barycentric(&below.position, &surface.triangle(below.face as usize));
        for channel in 0..3 {
            let blended: f64 = corners
                .iter()
                .zip(weights)
                .map(|(&corner, weight)| weight * f64::from(shown[corner as usize][channel]))
                .sum();
            sum += (blended - f64::from(color[channel])).powi(2);
        }
    }
    Ok((sum / (3 * colors.len()) as f64).sqrt())
}
