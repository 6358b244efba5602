//! How long each stage takes, by the size of the frame. `make bench` makes docs/PERFORMANCE.md of
//! it.
//!
//! One thread throughout. Few samples and short times, so that a run stays below ten minutes: the
//! stages that need two registered frames end at 100,000 faces, the others at a million.

mod input;

use std::path::PathBuf;
use std::time::Duration;

use criterion::{BatchSize, BenchmarkId, Criterion, SamplingMode, Throughput, criterion_group};
use input::{Alone, Sequence, Stage, Together};

const FACE_COUNTS: [usize; 7] = [5_000, 10_000, 20_000, 50_000, 100_000, 500_000, 1_000_000];

/// Beyond it a run of the stages that need two frames would take most of the time.
const MOST_FACES_TOGETHER: usize = 100_000;

const CAPTURES: [&str; 3] = ["basketball_player", "liam", "textured"];

fn stages(criterion: &mut Criterion) {
    for face_count in FACE_COUNTS {
        bench(criterion, &Sequence::of_rig(face_count));
    }
    let folder = std::env::var_os("STEADYMESH_DATA").map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data"),
        PathBuf::from,
    );
    for name in CAPTURES {
        if let Some(sequence) = Sequence::of_captures(&folder.join(name)) {
            bench(criterion, &sequence);
        }
    }
}

fn bench(criterion: &mut Criterion, sequence: &Sequence) {
    let alone = Alone::new(sequence);
    run(criterion, sequence, alone.stages());
    if sequence.face_count() <= MOST_FACES_TOGETHER + MOST_FACES_TOGETHER / 10 {
        run(
            criterion,
            sequence,
            Together::new(sequence, &alone).stages(),
        );
    }
}

fn run(criterion: &mut Criterion, sequence: &Sequence, stages: Vec<Stage<'_>>) {
    for (name, stage) in stages {
        let mut group = criterion.benchmark_group(name);
        group
            .sample_size(10)
            .sampling_mode(SamplingMode::Flat)
            .warm_up_time(Duration::from_millis(100))
            .measurement_time(Duration::from_millis(600))
            .throughput(Throughput::Elements(sequence.face_count() as u64));
        group.bench_function(BenchmarkId::from_parameter(&sequence.name), |bencher| {
            bencher.iter_batched(&stage, |run| run(), BatchSize::PerIteration);
        });
        group.finish();
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default().without_plots().nresamples(2_000);
    targets = stages
}

fn main() {
    // As the server does it.
    steadymesh_heap::keep();
    benches();
    Criterion::default().configure_from_args().final_summary();
}
