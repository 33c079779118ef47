//! Same scene, same bits: on any number of threads and any instruction set.

use super::{conservation::COLLISION, cosplat_simulate, simulate};

/// Instruction sets that this processor has, and those it lacks.
fn instruction_sets() -> (Vec<&'static str>, Vec<&'static str>) {
    #[cfg(target_arch = "x86_64")]
    let available = |isa: &&str| match *isa {
        "avx512" => {
            is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512dq")
                && is_x86_feature_detected!("avx512bw")
                && is_x86_feature_detected!("avx512vl")
        }
        "avx2" => is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma"),
        _ => true,
    };
    #[cfg(not(target_arch = "x86_64"))]
    let available = |isa: &&str| *isa == "portable";
    ["avx512", "avx2", "portable"]
        .into_iter()
        .partition(available)
}

#[test]
fn threads_and_instruction_sets_do_not_change_a_bit() {
    // Long enough for the collision and several sorts.
    let run = |options: &[&str]| simulate(COLLISION, 0.4, options);
    let expected = run(&["--threads", "1"]);
    let hash = &expected.last()["state_hash"];
    assert!(
        hash.is_string() && hash != &expected.first()["state_hash"],
        "the state has a hash"
    );
    // The report holds every energy, momentum and hash, and no timings: all of it has to be equal.
    assert_eq!(expected.text, run(&["--threads", "2"]).text, "2 threads");
    let (available, _) = instruction_sets();
    for isa in available {
        assert_eq!(expected.text, run(&["--isa", isa]).text, "{isa}");
    }
}

#[test]
fn an_instruction_set_that_is_missing_is_refused_by_name() {
    let (_, missing) = instruction_sets();
    for isa in missing.into_iter().chain(["mmx"]) {
        let output = cosplat_simulate(COLLISION, 0.1, &["--isa", isa]);
        let message = String::from_utf8_lossy(&output.stderr);
        assert!(
            !output.status.success() && message.contains(isa),
            "{isa}: {message}"
        );
    }
}
