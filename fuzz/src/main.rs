//! The search by coverage: libFuzzer over the target that `COSPLAT_FUZZ_TARGET` names. See `fuzz/run`.

#![no_main]

use std::{cell::OnceCell, path::Path};

use cosplat_fuzz::{Target, mutate::mutate};
use libfuzzer_sys::{fuzz_mutator, fuzz_target, fuzzer_mutate};
use rand_pcg::Pcg32;

thread_local! {
    static TARGET: OnceCell<&'static Target> = const { OnceCell::new() };
}

/// The target that this process searches.
fn target() -> &'static Target {
    TARGET.with(|target| {
        *target.get_or_init(|| {
            let name = std::env::var("COSPLAT_FUZZ_TARGET").unwrap_or_default();
            Target::named(&name).unwrap_or_else(|| panic!("COSPLAT_FUZZ_TARGET is {name:?}"))
        })
    })
}

/// One thread, this one, does all the work; the seeds are put where the search begins.
fn begin() {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .use_current_thread();
    pool.build_global().expect("the first pool of this process");
    let Some(folder) = std::env::var_os("COSPLAT_FUZZ_CORPUS") else {
        return;
    };
    let folder = Path::new(&folder);
    std::fs::create_dir_all(folder).expect("the folder of the corpus can be made");
    for (n, seed) in (target().seeds)().iter().enumerate() {
        std::fs::write(folder.join(format!("seed-{n}")), seed).expect("a seed can be written");
    }
}

fuzz_target!(init: begin(), |data: &[u8]| target().run(data));

fuzz_mutator!(|data: &mut [u8], size: usize, max_size: usize, seed: u32| {
    // Half of the time by what the format is, half by what coverage suggests.
    if seed & 1 == 0 {
        return fuzzer_mutate(data, size, max_size);
    }
    let mut rng = Pcg32::new(seed.into(), 0);
    let mutated = mutate(target(), &data[..size], &mut rng);
    let length = mutated.len().min(max_size);
    data[..length].copy_from_slice(&mutated[..length]);
    length
});
