//! Summary of a set of distances.

/// Summary of the distances dᵢ from `count` samples of one mesh to another.
///
/// - `mean`: (1/n) Σ dᵢ
/// - `variance`: (1/n) Σ (dᵢ − mean)², the population's
/// - `std`: √variance
/// - `mse`: (1/n) Σ dᵢ²
/// - `rmse`: √mse
/// - `max`: maxᵢ dᵢ, the one-sided Hausdorff distance over these samples
///
/// Unit: that of the positions (squared for `variance` and `mse`). One-sided: measure both
/// directions and take the larger of each field for a symmetric figure.
///
/// Source: the indicators of section 4.3 of "Tracked QEM Algorithm", with `mse` as the plain
/// mean of squares (the paper's own MSE column is smaller than the square of its mean, which
/// no mean of squares can be); Cignoni, Rocchini and Scopigno, "Metro: Measuring Error on
/// Simplified Surfaces", Computer Graphics Forum 17(2), 1998,
/// <https://doi.org/10.1111/1467-8659.00236>.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct DistanceStatistics {
    /// How many distances there are.
    pub count: usize,
    /// Their mean.
    pub mean: f64,
    /// The mean of their squared deviations from the mean.
    pub variance: f64,
    /// The square root of `variance`.
    pub std: f64,
    /// The mean of their squares.
    pub mse: f64,
    /// The square root of `mse`.
    pub rmse: f64,
    /// The largest of them.
    pub max: f64,
}

impl DistanceStatistics {
    /// Sums up `distances`; all zero if there are none.
    #[must_use]
    pub fn of(distances: &[f64]) -> Self {
        if distances.is_empty() {
            return Self::default();
        }
        let count = distances.len();
        let mean_of = |value: fn(f64, f64) -> f64, about: f64| {
            distances.iter().map(|&d| value(d, about)).sum::<f64>() / count as f64
        };
        let mean = mean_of(|d, _| d, 0.0);
        let square = |d: f64, about: f64| (d - about) * (d - about);
        let (variance, mse) = (mean_of(square, mean), mean_of(square, 0.0));
        let max = distances.iter().copied().fold(0.0, f64::max);
        Self {
            count,
            mean,
            variance,
            std: variance.sqrt(),
            mse,
            rmse: mse.sqrt(),
            max,
        }
    }

    /// The distance below which a share `quantile` (0 to 1) of `distances` lies; 0 if there are
    /// none. The nearest rank, without interpolation.
    #[must_use]
    pub fn quantile(distances: &[f64], quantile: f64) -> f64 {
        let mut sorted = distances.to_vec();
        sorted.sort_unstable_by(f64::total_cmp);
        let rank = (quantile.clamp(0.0, 1.0) * sorted.len() as f64).ceil() as usize;
        sorted.get(rank.max(1) - 1).copied().unwrap_or(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_four_and_five_have_the_statistics_that_one_works_out_by_hand() {
        let statistics = DistanceStatistics::of(&[3.0, 4.0, 5.0]);
        assert_eq!(
            (statistics.count, statistics.mean, statistics.max),
            (3, 4.0, 5.0)
        );
        assert!((statistics.variance - 2.0 / 3.0).abs() < 1e-15);
        assert!((statistics.mse - 50.0 / 3.0).abs() < 1e-14);
        assert!((statistics.rmse * statistics.rmse - statistics.mse).abs() < 1e-14);
        assert!((statistics.std * statistics.std - statistics.variance).abs() < 1e-14);
    }

    #[test]
    fn a_quantile_is_one_of_the_distances() {
        let distances: Vec<f64> = (1..=100).map(f64::from).collect();
        assert_eq!(DistanceStatistics::quantile(&distances, 0.95), 95.0);
        assert_eq!(DistanceStatistics::quantile(&distances, 1.0), 100.0);
        assert_eq!(DistanceStatistics::quantile(&[], 0.5), 0.0);
    }
}
