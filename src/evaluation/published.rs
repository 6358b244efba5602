//! The paper's own figures: Tables 1 to 4 of "Tracked QEM Algorithm", section 4.3.
//!
//! Their unit is not stated, so only shares of them can be compared.

use super::results::{ByFrame, Measure};

/// Ave, Var, STD, MSE and RMSE as printed.
pub(super) type Indicators = [f64; 5];

/// One of the paper's tables.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct PublishedTable {
    /// Its title.
    pub title: &'static str,
    /// Whether it shows the best pair, or else the average.
    pub is_best: bool,
    /// What was measured.
    pub measure: Measure,
    /// The rows "Orig QEM".
    pub original: ByFrame<Indicators>,
    /// The rows "Track QEM".
    pub tracked: ByFrame<Indicators>,
}

/// Tables 1 to 4.
pub(super) const TABLES: [PublishedTable; 4] = [
    PublishedTable {
        title: "Table 1: best result of mesh surface distance",
        is_best: true,
        measure: Measure::Surface,
        original: rows(
            [82.73, 6143.0, 78.37, 56.97, 7.547],
            [46.23, 2129.0, 46.14, 21.48, 4.635],
        ),
        tracked: rows(
            [52.36, 2448.0, 49.47, 22.42, 4.734],
            [45.80, 1975.0, 44.44, 20.41, 4.518],
        ),
    },
    PublishedTable {
        title: "Table 2: best result of nearest vertex distance",
        is_best: true,
        measure: Measure::Vertex,
        original: rows(
            [178.2, 28798.0, 169.7, 122.4, 11.06],
            [139.0, 22320.0, 149.4, 117.3, 10.82],
        ),
        tracked: rows(
            [144.7, 24211.0, 155.6, 125.2, 11.19],
            [134.8, 20793.0, 144.2, 113.4, 10.64],
        ),
    },
    PublishedTable {
        title: "Table 3: average value of mesh surface distance",
        is_best: false,
        measure: Measure::Surface,
        original: rows(
            [101.4, 18424.0, 135.7, 95.34, 9.764],
            [57.84, 4578.0, 67.66, 48.40, 6.957],
        ),
        tracked: rows(
            [64.26, 4246.0, 65.16, 55.25, 7.433],
            [60.96, 4122.0, 64.20, 52.52, 7.247],
        ),
    },
    PublishedTable {
        title: "Table 4: average value of nearest vertex distance",
        is_best: false,
        measure: Measure::Vertex,
        original: rows(
            [222.4, 55731.0, 236.0, 220.5, 14.85],
            [174.5, 33238.0, 182.3, 176.3, 13.27],
        ),
        tracked: rows(
            [187.5, 37425.0, 193.4, 167.7, 12.95],
            [185.0, 35124.0, 187.4, 165.9, 12.88],
        ),
    },
];

const fn rows(previous: Indicators, current: Indicators) -> ByFrame<Indicators> {
    ByFrame {
        previous: Some(previous),
        current,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_printed_deviations_are_the_roots_of_the_printed_squares() {
        for table in TABLES {
            for rows in [&table.original, &table.tracked] {
                for (mesh, [_, variance, std, mse, rmse]) in rows.named() {
                    let label = format!("{} {mesh}", table.title);
                    // Within what the last printed digit allows.
                    assert!((variance.sqrt() / std - 1.0).abs() < 1e-3, "{label}");
                    assert!((mse.sqrt() / rmse - 1.0).abs() < 1e-3, "{label}");
                }
            }
        }
    }
}
