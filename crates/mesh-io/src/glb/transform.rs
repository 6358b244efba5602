//! Affine transforms of nodes.

use super::document::Node;

/// `world_from_local`: a 3 by 3 matrix in rows, and a translation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Transform {
    rows: [[f64; 3]; 3],
    translation: [f64; 3],
}

impl Transform {
    pub(super) const IDENTITY: Self = Self {
        rows: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        translation: [0.0; 3],
    };

    /// A node's own transform: its matrix, or translation · rotation · scale.
    pub(super) fn of(node: &Node) -> Self {
        if let Some(m) = &node.matrix {
            return Self {
                rows: [[m[0], m[4], m[8]], [m[1], m[5], m[9]], [m[2], m[6], m[10]]],
                translation: [m[12], m[13], m[14]],
            };
        }
        let rotation = rotation(node.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]));
        let scale = node.scale.unwrap_or([1.0; 3]);
        Self {
            rows: rotation.map(|row| std::array::from_fn(|i| row[i] * scale[i])),
            translation: node.translation.unwrap_or_default(),
        }
    }

    /// `self` · `local`: first `local`, then `self`.
    pub(super) fn then_local(&self, local: &Self) -> Self {
        let column = |i: usize| local.rows.map(|row| row[i]);
        let columns = [0, 1, 2].map(|i| self.linear(column(i)));
        Self {
            rows: [0, 1, 2].map(|row| columns.map(|column| column[row])),
            translation: self.point(local.translation),
        }
    }

    pub(super) fn point(&self, point: [f64; 3]) -> [f64; 3] {
        let moved = self.linear(point);
        [0, 1, 2].map(|i| moved[i] + self.translation[i])
    }

    /// True if triangles change their winding.
    pub(super) fn is_mirrored(&self) -> bool {
        let cofactors = self.cofactors();
        dot(self.rows[0], cofactors[0]) < 0.0
    }

    /// Moves a normal by the inverse transpose and makes it a unit vector again; a
    /// transform that flattens space gives zero.
    pub(super) fn normal(&self, normal: [f32; 3]) -> [f32; 3] {
        let normal = normal.map(f64::from);
        let sign = if self.is_mirrored() { -1.0 } else { 1.0 };
        let moved = self.cofactors().map(|row| dot(row, normal) * sign);
        let length = dot(moved, moved).sqrt();
        if length.is_normal() {
            moved.map(|value| (value / length) as f32)
        } else {
            [0.0; 3]
        }
    }

    fn linear(&self, vector: [f64; 3]) -> [f64; 3] {
        self.rows.map(|row| dot(row, vector))
    }

    /// The cofactor matrix: the inverse transpose times the determinant.
    fn cofactors(&self) -> [[f64; 3]; 3] {
        let [a, b, c] = self.rows;
        [cross(b, c), cross(c, a), cross(a, b)]
    }
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

/// The matrix of a quaternion x, y, z, w, which is normalized first.
fn rotation(quaternion: [f64; 4]) -> [[f64; 3]; 3] {
    let squared: f64 = quaternion.iter().map(|value| value * value).sum();
    if !squared.is_normal() {
        return Transform::IDENTITY.rows;
    }
    let [x, y, z, w] = quaternion.map(|value| value / squared.sqrt());
    [
        [
            1.0 - 2.0 * (y * y + z * z),
            2.0 * (x * y - z * w),
            2.0 * (x * z + y * w),
        ],
        [
            2.0 * (x * y + z * w),
            1.0 - 2.0 * (x * x + z * z),
            2.0 * (y * z - x * w),
        ],
        [
            2.0 * (x * z - y * w),
            2.0 * (y * z + x * w),
            1.0 - 2.0 * (x * x + y * y),
        ],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn node(json: &str) -> Node {
        serde_json::from_str(json).unwrap()
    }

    fn close(a: [f64; 3], b: [f64; 3]) -> bool {
        (0..3).all(|i| (a[i] - b[i]).abs() < 1e-12)
    }

    #[test]
    fn scale_comes_first_then_rotation_then_translation() {
        // A quarter turn about z.
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let text = format!(
            "{{\"translation\":[10,0,0],\"rotation\":[0,0,{half},{half}],\"scale\":[2,1,1]}}"
        );
        let transform = Transform::of(&node(&text));
        assert!(close(transform.point([1.0, 0.0, 0.0]), [10.0, 2.0, 0.0]));
    }

    #[test]
    fn a_matrix_is_stored_by_columns() {
        let text = "{\"matrix\":[0,1,0,0, -1,0,0,0, 0,0,1,0, 5,6,7,1]}";
        let transform = Transform::of(&node(text));
        assert!(close(transform.point([1.0, 2.0, 3.0]), [3.0, 7.0, 10.0]));
    }

    #[test]
    fn the_parent_applies_last() {
        let parent = Transform::of(&node("{\"scale\":[2,2,2]}"));
        let child = Transform::of(&node("{\"translation\":[1,0,0]}"));
        assert!(close(
            parent.then_local(&child).point([0.0; 3]),
            [2.0, 0.0, 0.0]
        ));
    }

    #[test]
    fn normals_stay_perpendicular_and_point_outward() {
        let squeeze = Transform::of(&node("{\"scale\":[2,1,1]}"));
        let normal = squeeze.normal([0.6, 0.8, 0.0]);
        // The tangent (-0.8, 0.6) becomes (-1.6, 0.6).
        assert!((normal[0] * -1.6 + normal[1] * 0.6).abs() < 1e-6);
        let mirror = Transform::of(&node("{\"scale\":[-1,1,1]}"));
        assert!(mirror.is_mirrored());
        assert_eq!(mirror.normal([1.0, 0.0, 0.0]), [-1.0, 0.0, 0.0]);
    }
}
