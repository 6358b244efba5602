//! Vertex colors on `v` records, an extension that many scanners write.

/// Colors in the order of the vertices, as long as every vertex has one.
pub(super) struct Colors {
    /// Red, green, blue, alpha; alpha is NaN where the file has none.
    values: Vec<[f64; 4]>,
    is_complete: bool,
}

impl Default for Colors {
    fn default() -> Self {
        Self {
            values: Vec::new(),
            is_complete: true,
        }
    }
}

impl Colors {
    pub(super) fn push(&mut self, color: Option<[f64; 4]>) {
        match color {
            Some(color) if self.is_complete => self.values.push(color),
            _ => {
                self.is_complete = false;
                self.values = Vec::new();
            }
        }
    }

    /// Colors from 0 to 255. A file with a channel above 1 counts to 255, others to 1.
    pub(super) fn finish(self) -> Option<Vec<[u8; 4]>> {
        if !self.is_complete || self.values.is_empty() {
            return None;
        }
        let counts_to_255 = self.values.iter().flatten().any(|&channel| channel > 1.0);
        let scale = if counts_to_255 { 1.0 } else { 255.0 };
        // `as` clamps, and sends NaN to 0.
        let channel = |value: f64| (value * scale).round() as u8;
        let convert = |[red, green, blue, alpha]: [f64; 4]| {
            let alpha = if alpha.is_nan() {
                u8::MAX
            } else {
                channel(alpha)
            };
            [channel(red), channel(green), channel(blue), alpha]
        };
        Some(self.values.into_iter().map(convert).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn finish(colors: &[Option<[f64; 4]>]) -> Option<Vec<[u8; 4]>> {
        let mut all = Colors::default();
        colors.iter().for_each(|&color| all.push(color));
        all.finish()
    }

    #[test]
    fn both_scales_are_understood() {
        let fractions = finish(&[Some([0.0, 0.5, 1.0, f64::NAN])]);
        assert_eq!(fractions, Some(vec![[0, 128, 255, 255]]));
        let bytes = finish(&[Some([0.0, 128.0, 300.0, 7.0]), Some([1.0, 1.0, 1.0, 1.0])]);
        assert_eq!(bytes, Some(vec![[0, 128, 255, 7], [1, 1, 1, 1]]));
    }

    #[test]
    fn one_vertex_without_a_color_means_no_colors() {
        assert_eq!(finish(&[Some([0.0; 4]), None, Some([0.0; 4])]), None);
    }
}
