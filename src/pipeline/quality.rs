//! What is left out of a frame's processing when there is no time for all of it.

use steadymesh_geometry::registration;
use steadymesh_proto::metrics::{Quality, Tracking};
use steadymesh_proto::stream::MetricsMode;

use super::Settings;

impl Settings {
    /// The qualities that differ for these settings, the full one first, each cheaper than the
    /// one before.
    #[must_use]
    pub fn qualities(&self) -> Vec<Quality> {
        let mut qualities = vec![Quality::Full];
        if self.metrics == MetricsMode::Full {
            qualities.push(Quality::Sampled);
        }
        if self.tracking != Tracking::Off {
            qualities.extend([Quality::Quick, Quality::Untracked]);
        }
        qualities
    }

    /// These settings with as much left out as `quality` says. Each quality leaves out what the
    /// one before it does, too.
    #[must_use]
    pub fn at(&self, quality: Quality) -> Self {
        let mut settings = self.clone();
        if quality != Quality::Full && settings.metrics == MetricsMode::Full {
            settings.metrics = MetricsMode::Sampled;
        }
        match quality {
            Quality::Full | Quality::Sampled => {}
            Quality::Quick => {
                settings.registration = quick(&self.registration);
                settings.refines = false;
            }
            Quality::Untracked => settings.tracking = Tracking::Off,
        }
        settings
    }
}

/// A coarser deformation from fewer samples in fewer rounds. On captures it takes two thirds of
/// the time, and the residual is up to a third larger.
fn quick(full: &registration::Options) -> registration::Options {
    let mut options = full.clone();
    let nonrigid = &mut options.nonrigid;
    nonrigid.graph.node_spacing *= 2.0;
    nonrigid.samples /= 4;
    nonrigid.coarse_samples /= 2;
    nonrigid.final_rounds = 1;
    options.rigid.fine_samples /= 2;
    options
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_done_anyway_is_not_left_out() {
        let full = Settings::default();
        assert_eq!(
            full.qualities(),
            [
                Quality::Full,
                Quality::Sampled,
                Quality::Quick,
                Quality::Untracked
            ]
        );
        let bare = Settings {
            tracking: Tracking::Off,
            metrics: MetricsMode::Off,
            ..full
        };
        assert_eq!(bare.qualities(), [Quality::Full]);
        assert_eq!(bare.at(Quality::Untracked), bare);
    }
}
