//! When something is worth telling: stalls, and figures that leave their bounds for good.
//!
//! Without a clock of its own: times are passed in.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use crate::streams::{FrameEvent, StreamName};

use super::{Bound, Crossing, Details, Kind, Limit, Options, Silence};

/// When what happens is told.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Rules {
    stall_after: Duration,
    exceeded_after: u32,
    restored_after: u32,
    bounds: Vec<(Bound, Limit)>,
}

impl Rules {
    /// The options are expected to have been checked.
    pub fn new(options: &Options) -> Self {
        let with_limit = |bound: &Bound| Some((bound.clone(), bound.limit().ok()?));
        Self {
            stall_after: Duration::from_secs(options.stall_secs),
            exceeded_after: options.exceeded_after_frames,
            restored_after: options.restored_after_frames,
            bounds: options.bounds.iter().filter_map(with_limit).collect(),
        }
    }
}

/// Watches all streams that have started.
#[derive(Debug)]
pub(super) struct Monitor {
    rules: Rules,
    streams: BTreeMap<StreamName, Watched>,
}

#[derive(Debug)]
struct Watched {
    last_frame: Instant,
    seq: u64,
    has_stalled: bool,
    /// One for each bound.
    alarms: Vec<Alarm>,
}

/// A figure's state with hysteresis: it changes sides only after several frames in a row there.
#[derive(Debug, Clone, Copy, Default)]
struct Alarm {
    is_raised: bool,
    /// Frames in a row on the other side.
    run: u32,
}

/// What is to be told of a stream.
pub(super) type Finding = (Kind, Details);

impl Monitor {
    pub fn new(rules: Rules) -> Self {
        let streams = BTreeMap::new();
        Self { rules, streams }
    }

    /// Takes new rules. Figures that are out of bounds count anew.
    pub fn set_rules(&mut self, rules: Rules) {
        if self.rules.bounds != rules.bounds {
            for watched in self.streams.values_mut() {
                watched.alarms = vec![Alarm::default(); rules.bounds.len()];
            }
        }
        self.rules = rules;
    }

    /// A stream has started.
    pub fn start(&mut self, stream: StreamName, seq: u64, now: Instant) {
        let watched = Watched {
            last_frame: now,
            seq,
            has_stalled: false,
            alarms: vec![Alarm::default(); self.rules.bounds.len()],
        };
        self.streams.insert(stream, watched);
    }

    /// A stream has ended: nothing more will be found.
    pub fn end(&mut self, stream: &StreamName) {
        self.streams.remove(stream);
    }

    /// A frame is out.
    pub fn frame(&mut self, event: &FrameEvent, now: Instant) -> Vec<Finding> {
        // A frame of a stream that has ended since.
        let Some(watched) = self.streams.get_mut(&event.stream) else {
            return Vec::new();
        };
        let mut findings = Vec::new();
        if std::mem::take(&mut watched.has_stalled) {
            let silence = silence(&event.stream, event.seq, now - watched.last_frame);
            findings.push((Kind::Resumed, Details::Silence(silence)));
        }
        watched.last_frame = now;
        watched.seq = event.seq;
        for ((bound, limit), alarm) in self.rules.bounds.iter().zip(&mut watched.alarms) {
            if !bound.is_about(&event.stream) {
                continue;
            }
            let Some(value) = bound.figure.of(&event.figures) else {
                // Not measured: it says nothing either way.
                continue;
            };
            let is_out = limit.is_exceeded_by(value);
            let needed = if alarm.is_raised {
                self.rules.restored_after
            } else {
                self.rules.exceeded_after
            };
            if alarm.observe(is_out, needed) {
                let kind = if is_out {
                    Kind::Exceeded
                } else {
                    Kind::Restored
                };
                let crossing = Crossing {
                    stream: event.stream.to_string(),
                    seq: event.seq,
                    figure: bound.figure,
                    value,
                    bound: *limit,
                    frames: needed,
                };
                findings.push((kind, Details::Crossing(crossing)));
            }
        }
        findings
    }

    /// Some time has passed.
    pub fn tick(&mut self, now: Instant) -> Vec<(StreamName, Finding)> {
        let mut findings = Vec::new();
        for (name, watched) in &mut self.streams {
            let silent_for = now.saturating_duration_since(watched.last_frame);
            if !watched.has_stalled && self.rules.stall_after <= silent_for {
                watched.has_stalled = true;
                let silence = Details::Silence(silence(name, watched.seq, silent_for));
                findings.push((name.clone(), (Kind::Stalled, silence)));
            }
        }
        findings
    }
}

impl Alarm {
    /// Whether the alarm is raised or cleared by this frame.
    fn observe(&mut self, is_out: bool, needed: u32) -> bool {
        if is_out == self.is_raised {
            self.run = 0;
            return false;
        }
        self.run += 1;
        let changes = needed <= self.run;
        if changes {
            *self = Self {
                is_raised: is_out,
                run: 0,
            };
        }
        changes
    }
}

fn silence(stream: &StreamName, seq: u64, lasted: Duration) -> Silence {
    Silence {
        stream: stream.to_string(),
        seq,
        // To the millisecond: more would be noise.
        silent_secs: (lasted.as_secs_f64() * 1000.0).round() / 1000.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::streams::Figures;
    use crate::webhooks::Figure;

    fn monitor(start: Instant) -> Monitor {
        let bound = Bound {
            figure: Figure::Flicker,
            min: None,
            max: Some(0.01),
            streams: vec!["rig-*".parse().unwrap()],
        };
        let options = Options {
            exceeded_after_frames: 3,
            restored_after_frames: 4,
            bounds: vec![bound],
            ..Options::default()
        };
        let mut monitor = Monitor::new(Rules::new(&options));
        for name in ["rig-1", "other"] {
            monitor.start(StreamName::parse(name).unwrap(), 0, start);
        }
        monitor
    }

    fn frame(stream: &str, seq: u64, flicker: Option<f64>) -> FrameEvent {
        FrameEvent {
            stream: StreamName::parse(stream).unwrap(),
            seq,
            figures: Figures {
                flicker,
                ..Figures::default()
            },
        }
    }

    /// The frames at which a figure crosses its bound.
    fn crossings(stream: &str, values: &[Option<f64>]) -> Vec<(u64, Kind)> {
        let now = Instant::now();
        let mut monitor = monitor(now);
        let frames = (0..)
            .zip(values)
            .map(|(seq, value)| frame(stream, seq, *value));
        let told = frames.flat_map(|frame| {
            let findings = monitor.frame(&frame, now);
            findings.into_iter().map(move |(kind, _)| (frame.seq, kind))
        });
        told.collect()
    }

    #[test]
    fn a_figure_that_flaps_around_its_bound_is_not_told() {
        let flapping: Vec<_> = (0..60)
            .map(|i| Some(if i % 3 == 0 { 0.0 } else { 1.0 }))
            .collect();
        assert_eq!(crossings("rig-1", &flapping), []);
    }

    #[test]
    fn a_figure_is_told_once_when_it_is_out_for_long_enough_and_once_when_it_is_back() {
        let mut values = vec![Some(1.0); 10];
        // A frame without the figure changes nothing.
        values.insert(2, None);
        values.extend([Some(0.0), Some(0.0), Some(0.0), Some(1.0)]);
        values.extend([Some(0.0); 10]);
        let told = [(3, Kind::Exceeded), (18, Kind::Restored)];
        assert_eq!(crossings("rig-1", &values), told);
        assert_eq!(crossings("other", &values), []);
    }

    #[test]
    fn a_stall_is_told_once_and_so_is_its_end() {
        let start = Instant::now();
        let mut monitor = monitor(start);
        let after = |secs| start + Duration::from_secs(secs);
        monitor.end(&StreamName::parse("other").unwrap());
        assert_eq!(monitor.tick(after(4)), []);
        let told = monitor.tick(after(6));
        assert_eq!((told.len(), told[0].1.0), (1, Kind::Stalled));
        assert_eq!(monitor.tick(after(7)), []);
        let told = monitor.frame(&frame("rig-1", 1, None), after(8));
        let silence = Silence {
            stream: "rig-1".to_owned(),
            seq: 1,
            silent_secs: 8.0,
        };
        assert_eq!(told, [(Kind::Resumed, Details::Silence(silence))]);
        assert_eq!(monitor.tick(after(9)), []);
    }
}
