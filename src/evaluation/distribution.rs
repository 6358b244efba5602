//! How distances are distributed, in memory that does not grow with their number.

/// The decades that are told apart: from 10⁻⁶ of the diagonal (well below the step of any
/// quantization in use) to the diagonal.
const DECADES: usize = 6;
/// Bins in a decade: each is 6 % wide, less than a plot's line.
const BINS_PER_DECADE: usize = 40;

/// A histogram over the logarithm of the distance.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Distribution {
    /// Distances not above the upper edge of each bin, but above that of the one before.
    counts: Vec<u64>,
    total: u64,
}

impl Default for Distribution {
    fn default() -> Self {
        Self {
            counts: vec![0; DECADES * BINS_PER_DECADE + 1],
            total: 0,
        }
    }
}

impl Distribution {
    /// Adds `distances`, each divided by `diagonal`.
    pub fn add(&mut self, distances: &[f64], diagonal: f64) {
        for distance in distances {
            let exponent = (distance / diagonal).log10() + DECADES as f64;
            // The cast takes 0 (minus infinity) and what is not a number to the lowest bin.
            let bin = (exponent * BINS_PER_DECADE as f64).ceil() as usize;
            // What is above the diagonal is counted in the total only.
            if let Some(count) = self.counts.get_mut(bin) {
                *count += 1;
            }
        }
        self.total += distances.len() as u64;
    }

    /// Points of the cumulative distribution: the upper edge of each bin in percent of the
    /// diagonal, and the share of the distances that are not above it. From the last bin
    /// without a share to the first with all; empty without distances.
    pub fn cumulative(&self) -> Vec<[f64; 2]> {
        let mut below = 0;
        let mut points = Vec::new();
        for (bin, count) in self.counts.iter().enumerate() {
            below += count;
            let exponent = bin as f64 / BINS_PER_DECADE as f64 - DECADES as f64;
            let edge = 100.0 * 10f64.powf(exponent);
            if below == 0 {
                points.clear();
            }
            points.push([edge, below as f64 / self.total.max(1) as f64]);
            if below == self.total {
                break;
            }
        }
        if self.total == 0 { Vec::new() } else { points }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_share_below_a_distance_is_found_again_within_a_bin() {
        let mut distribution = Distribution::default();
        let distances: Vec<f64> = (1..=1000).map(|i| f64::from(i) / 100.0).collect();
        distribution.add(&distances[..400], 1000.0);
        distribution.add(&distances[400..], 1000.0);
        let points = distribution.cumulative();
        for [percent, share] in &points {
            let exact = (percent / 100.0 * 1000.0 / 10.0).min(1.0);
            assert!((share - exact).abs() < 2e-3, "{percent}: {share} {exact}");
        }
        assert_eq!(points[0][1], 0.0);
        assert_eq!(points.last().unwrap()[1], 1.0);
    }

    #[test]
    fn distances_of_zero_and_beyond_the_diagonal_are_not_lost() {
        let mut distribution = Distribution::default();
        distribution.add(&[0.0, 0.0, 0.5, 7.0], 1.0);
        let points = distribution.cumulative();
        assert!((points[0][0] - 1e-4).abs() < 1e-15 && points[0][1] == 0.5);
        assert_eq!(points.last().unwrap()[1], 0.75);
        assert!(Distribution::default().cumulative().is_empty());
    }
}
