//! Progress bars: on a terminal, and nothing anywhere else.

use std::io::IsTerminal;

use indicatif::{ProgressBar, ProgressStyle};

/// A bar for work on a known number of frames.
pub(super) fn progress_bar(frames: u64) -> ProgressBar {
    styled(
        ProgressBar::new(frames),
        "{bar:40} {pos}/{len} frames, {eta} left",
    )
}

/// A line for frames that come for as long as they come.
pub(super) fn counter() -> ProgressBar {
    styled(ProgressBar::no_length(), "{pos} frames, {per_sec}")
}

fn styled(bar: ProgressBar, template: &str) -> ProgressBar {
    if !std::io::stderr().is_terminal() {
        bar.set_draw_target(indicatif::ProgressDrawTarget::hidden());
        return bar;
    }
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style);
    }
    bar
}
