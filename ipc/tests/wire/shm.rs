//! Shared memory that is too small.

use super::{child::Process, support::TestDomain};

/// A command line that runs the next one with 30 MiB of shared memory, if this system permits one.
fn cramped() -> Option<Vec<&'static str>> {
    const SCRIPT: &str = "mount -t tmpfs -o size=30m tmpfs /dev/shm && exec \"$0\" \"$@\"";
    [&["-m"][..], &["-r", "-m"]].into_iter().find_map(|flags| {
        let mut line = vec!["unshare"];
        line.extend(flags);
        line.extend(["sh", "-c", SCRIPT]);
        let permitted = std::process::Command::new(line[0])
            .args(&line[1..])
            .arg("true")
            .stderr(std::process::Stdio::null())
            .status();
        permitted
            .is_ok_and(|status| status.success())
            .then_some(line)
    })
}

/// It is never a crash.
#[test]
fn too_little_shared_memory_is_refused_with_both_numbers() {
    let Some(wrapper) = cramped() else {
        let why = "a mount namespace is not permitted here";
        assert!(std::env::var_os("COSPLAT_REQUIRE_ALL").is_none(), "{why}");
        eprintln!("SKIPPED: too_little_shared_memory_is_refused: {why}");
        return;
    };
    let domain = TestDomain::new();
    let mut child = Process::start(&wrapper, &domain, "cramped", "small");
    let refusal = child.hear().expect("an answer");
    // 8 frames of 64 MiB, and 19 MiB for answers and the other streams, do not fit into 30 MiB.
    assert!(refusal.contains("shared memory is too small"), "{refusal}");
    assert!(
        refusal.contains("531 MiB required, 29 MiB available"),
        "{refusal}"
    );
    // Frames of 1 MiB do, though not as many as usual, and every page is really there.
    let slots = child.hear().expect("the second session");
    let slots: usize = slots
        .strip_suffix(" slots")
        .expect("a number")
        .parse()
        .expect("a number");
    assert!((8..16).contains(&slots), "{slots}");
    assert_eq!(child.hear().as_deref(), Some("100 frames"));
}
