//! One run of the stage that is named, for Callgrind to count its instructions:
//! `scripts/bench-instructions` calls it. Without a name it says what stages there are.

#![allow(clippy::print_stdout, reason = "a tool for developers")]

mod input;

use input::{Alone, Run, Sequence, Together};

/// Enough to be typical, few enough for a simulated processor.
const FACE_COUNT: usize = 10_000;

fn main() {
    let wanted = std::env::args()
        .nth(1)
        .filter(|name| !name.starts_with('-'));
    let sequence = Sequence::of_rig(FACE_COUNT);
    let alone = Alone::new(&sequence);
    let together = Together::new(&sequence, &alone);
    let stages = alone.stages().into_iter().chain(together.stages());
    for (name, stage) in stages {
        match &wanted {
            None => println!("{name}"),
            Some(wanted) if wanted == name => counted_stage(stage()),
            Some(_) => {}
        }
    }
}

/// Callgrind counts from where this is entered to where it is left.
#[inline(never)]
fn counted_stage(run: Run<'_>) {
    run();
}
