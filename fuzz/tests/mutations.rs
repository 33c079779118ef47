//! Seeded mutations of sound inputs do no harm: a short form of what `fuzz/run` searches for longer.

use std::{
    panic::{AssertUnwindSafe, catch_unwind},
    sync::mpsc::{RecvTimeoutError, channel},
    time::Duration,
};

use cosplat_fuzz::{
    TARGETS, Target,
    mutate::{below, mutate},
};
use rand_pcg::Pcg32;
use rustix::time::{ClockId, clock_gettime};

/// Mutated inputs per target, unless `COSPLAT_FUZZ_ROUNDS` says another number.
const ROUNDS: u64 = 400;
/// What one input may take before the target is called hung: no assertion on speed, but an end to a test that has none.
const PATIENCE: Duration = Duration::from_secs(120);

/// Runs a target on its seeds and on seeded mutations of them, in a thread that is watched.
fn try_out(name: &str) {
    let target = Target::named(name).expect("a target");
    let (sender, receiver) = channel();
    let worker = std::thread::spawn(move || {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(1)
            .use_current_thread();
        let pool = pool.build().expect("a pool of this thread");
        pool.install(|| play(target, &|input| drop(sender.send(input))));
    });
    let mut latest = String::new();
    loop {
        match receiver.recv_timeout(PATIENCE) {
            Ok(input) => latest = input,
            Err(RecvTimeoutError::Timeout) => {
                eprintln!("{name} hangs at {latest}");
                std::process::abort();
            }
            Err(RecvTimeoutError::Disconnected) => break,
        }
    }
    worker.join().unwrap_or_else(|_| panic!("{name}: {latest}"));
}

fn play(target: &Target, tell: &dyn Fn(String)) {
    let seeds = (target.seeds)();
    for (n, seed) in seeds.iter().enumerate() {
        tell(format!("seed {n}"));
        target.run(seed);
    }
    let rounds = std::env::var("COSPLAT_FUZZ_ROUNDS");
    let rounds = rounds.map_or(ROUNDS, |rounds| rounds.parse().expect("a number of rounds"));
    let begin = processor_time();
    for round in 0..rounds {
        let mut rng = Pcg32::new(round, 1);
        let seed = below(&mut rng, seeds.len());
        let input = mutate(target, &seeds[seed], &mut rng);
        tell(format!("seed {seed}, round {round}"));
        target.run(&input);
    }
    let rate = rounds as f64 / (processor_time() - begin);
    println!(
        "{}: {rounds} executions, {rate:.0} per second of processor time",
        target.name
    );
}

/// Processor time of this thread [s].
fn processor_time() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

/// One test per target, so that each has its own thread and name.
macro_rules! mutated {
    ($($test:ident: $name:literal,)*) => {
        $(#[test]
        fn $test() {
            try_out($name);
        })*

        #[test]
        fn every_target_is_tried() {
            let tried = [$($name,)*];
            assert_eq!(TARGETS.iter().map(|t| t.name).collect::<Vec<_>>(), tried);
            let script = include_str!("../run");
            assert!(script.contains(&format!("targets='{}'", tried.join(" "))));
        }
    };
}

mutated! {
    mutated_ply_does_no_harm: "ply",
    mutated_splat_does_no_harm: "splat",
    mutated_meshes_do_no_harm: "mesh",
    mutated_scenes_do_no_harm: "scene",
    mutated_physgaussian_does_no_harm: "physgaussian",
    mutated_commands_do_no_harm: "command",
    mutated_checkpoints_do_no_harm: "checkpoint",
    mutated_recordings_do_no_harm: "recording",
    mutated_arrays_do_no_harm: "npy",
    mutated_masks_do_no_harm: "mask",
    mutated_objects_do_no_harm: "objects",
    mutated_trees_do_no_harm: "tree",
    mutated_colmap_texts_do_no_harm: "colmap_text",
    mutated_colmap_models_do_no_harm: "colmap_binary",
    mutated_transforms_do_no_harm: "transforms",
}

#[test]
fn a_target_that_holds_too_much_memory_is_caught() {
    fn hoard(_: &[u8]) {
        drop(Vec::<u8>::with_capacity(65 << 20));
    }
    let greedy = Target::new("greedy", hoard);
    let caught = catch_unwind(AssertUnwindSafe(|| greedy.run(&[])));
    let words = caught.expect_err("too much");
    let words = words.downcast_ref::<String>().expect("a sentence");
    assert!(words.contains("made greedy hold"), "{words}");
}
