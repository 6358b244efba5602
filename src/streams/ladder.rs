//! What a live stream leaves out before it drops frames.

use steadymesh_proto::metrics::Quality;

/// Where a stream stands between processing every frame in full and dropping some.
///
/// The fuller the queue, the further down at once: at half, at three quarters, and at the bottom
/// when it is full, which is before the first frame is dropped. Up again it goes by single steps,
/// each after a while in which no frame had to wait. A step up that did not last makes the next
/// one wait twice as long, so that a rig which is a little too fast does not see the quality
/// swing. A function of what it is told: no clock.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Ladder {
    /// Steps below the full quality.
    depth: usize,
    /// Frames started in a row for which nothing waited behind.
    calm: u32,
    /// How many of them it takes to go up.
    patience: u32,
    /// Frames started since the last step up.
    since_up: u32,
}

/// A second at 30 frames per second.
const MIN_PATIENCE: u32 = 30;
/// About half a minute.
const MAX_PATIENCE: u32 = 960;

impl Default for Ladder {
    fn default() -> Self {
        Self {
            depth: 0,
            calm: 0,
            patience: MIN_PATIENCE,
            since_up: u32::MAX,
        }
    }
}

impl Ladder {
    /// Goes down if the queue, with room for `room` frames, holds too many that nobody works on
    /// yet. `steps` is how many qualities there are below the full one.
    pub fn press(&mut self, waiting: usize, room: usize, steps: usize) {
        let wanted = match 4 * waiting / room.max(1) {
            0 | 1 => 0,
            2 => 1,
            3 => steps.saturating_sub(1).max(1),
            _ => steps,
        };
        let wanted = wanted.min(steps);
        if wanted <= self.depth {
            return;
        }
        if self.since_up <= self.patience {
            self.patience = (2 * self.patience).min(MAX_PATIENCE);
        }
        self.depth = wanted;
        self.calm = 0;
        self.since_up = u32::MAX;
    }

    /// The quality, out of `qualities` with the full one first, of a frame that is started on
    /// while `waiting` others wait.
    pub fn start(&mut self, waiting: usize, qualities: &[Quality]) -> Quality {
        // They may have become fewer.
        self.depth = self.depth.min(qualities.len().saturating_sub(1));
        self.calm = if waiting == 0 { self.calm + 1 } else { 0 };
        self.since_up = self.since_up.saturating_add(1);
        if 0 < self.depth && self.patience <= self.calm {
            self.depth -= 1;
            (self.calm, self.since_up) = (0, 0);
        } else if self.depth == 0 && 4 * self.patience <= self.calm {
            // It has held at the top for so long that the past does not count any more.
            self.patience = MIN_PATIENCE;
        }
        qualities.get(self.depth).copied().unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEPS: usize = Quality::ALL.len() - 1;

    fn start(ladder: &mut Ladder, waiting: usize) -> Quality {
        ladder.start(waiting, &Quality::ALL)
    }

    #[test]
    fn it_is_at_the_bottom_when_the_queue_is_full_and_not_before() {
        for room in 1..10 {
            let mut ladder = Ladder::default();
            for waiting in 0..room {
                ladder.press(waiting, room, STEPS);
                assert!(start(&mut ladder, waiting) < Quality::Untracked);
            }
            ladder.press(room, room, STEPS);
            assert_eq!(start(&mut ladder, room), Quality::Untracked);
        }
    }

    #[test]
    fn it_climbs_step_by_step_once_nothing_waits() {
        let mut ladder = Ladder::default();
        ladder.press(4, 4, STEPS);
        let seen: Vec<Quality> = (0..200).map(|_| start(&mut ladder, 0)).collect();
        let mut steps = seen.clone();
        steps.dedup();
        let up: Vec<Quality> = Quality::ALL.into_iter().rev().collect();
        assert_eq!(steps, up);
        assert_eq!(seen[28..30], [Quality::Untracked, Quality::Quick]);
    }

    #[test]
    fn a_rig_that_is_a_little_too_fast_does_not_make_it_swing() {
        // Only the cheapest quality keeps up; at any other one the queue fills.
        let mut ladder = Ladder::default();
        let (mut waiting, mut changes, mut last) = (0_usize, 0, Quality::Full);
        for _ in 0..10_000 {
            let quality = start(&mut ladder, waiting);
            changes += usize::from(quality != last);
            last = quality;
            waiting = if quality == Quality::Untracked {
                0
            } else {
                (waiting + 1).min(4)
            };
            ladder.press(waiting, 4, STEPS);
        }
        assert!(changes < 100, "{changes} changes");
    }

    #[test]
    fn a_frame_that_waits_keeps_it_from_climbing() {
        let mut ladder = Ladder::default();
        ladder.press(4, 4, STEPS);
        for frame in 0..1000 {
            assert_eq!(
                start(&mut ladder, usize::from(frame % 20 == 0)),
                Quality::Untracked
            );
        }
    }

    #[test]
    fn without_cheaper_qualities_it_stays_where_it_is() {
        let mut ladder = Ladder::default();
        ladder.press(4, 4, 0);
        assert_eq!(ladder.start(4, &[Quality::Full]), Quality::Full);
    }
}
