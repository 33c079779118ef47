//! The C header: compiled as C and as C++, it reads what the server's types write.

use std::{
    io::Write,
    path::Path,
    process::{Command, Stdio},
};

use cosplat_ipc::schema::{FrameHeader, GaussianState};

/// Reads a header and its Gaussians from standard input and says what is in them.
const PROGRAM: &str = r#"
#include "cosplat.h"
#include <stdio.h>

int main(void) {
    struct cosplat_frame_header header;
    struct cosplat_gaussian_state gaussian;
    if (fread(&header, sizeof header, 1, stdin) != 1) return 1;
    printf("step %llu at %g s: %u\n", (unsigned long long)header.step, header.sim_time, header.count);
    while (fread(&gaussian, sizeof gaussian, 1, stdin) == 1)
        printf("%g %u %g %u %g\n", gaussian.position[2], gaussian.color[3], gaussian.covariance[5], gaussian.object,
               gaussian.rotation[3]);
    return header.flags == COSPLAT_FRAME_FLAG_LAST ? 0 : 2;
}
"#;

fn reads_a_frame(compiler: &str, standard: &str, extension: &str) {
    let folder = tempfile::tempdir().expect("a folder");
    let source = folder.path().join(format!("reader.{extension}"));
    std::fs::write(&source, PROGRAM).expect("written");
    let program = folder.path().join("reader");
    let include = Path::new(env!("CARGO_MANIFEST_DIR")).join("../clients/c");
    let output = Command::new(compiler)
        .args([standard, "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-I"])
        .arg(include)
        .arg(&source)
        .arg("-o")
        .arg(&program)
        .output();
    let output = match output {
        Ok(output) => output,
        Err(error) => {
            let required = std::env::var_os("COSPLAT_REQUIRE_ALL").is_some();
            assert!(!required, "{compiler}: {error}");
            return eprintln!("SKIPPED: {compiler}: {error}");
        }
    };
    let words = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{words}");
    // The middleware changes the mask of this process for moments, in which a program is linked that may not be run.
    let may_run = std::os::unix::fs::PermissionsExt::from_mode(0o755);
    std::fs::set_permissions(&program, may_run).expect("its own file");

    let header = FrameHeader {
        step: 1 << 40,
        sim_time: 0.25,
        count: 2,
        flags: 4,
        ..FrameHeader::default()
    };
    let gaussian = |object: u32| GaussianState {
        position: [0.0, 0.0, 1.5],
        color: [1, 2, 3, 200],
        covariance: [0.0, 0.0, 0.0, 0.0, 0.0, 0.125],
        object,
        rotation: [0.0, 0.0, 0.0, 1.0],
        ..GaussianState::default()
    };
    let mut child = Command::new(&program)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("the program runs");
    let mut pipe = child.stdin.take().expect("its input");
    pipe.write_all(bytemuck::bytes_of(&header)).expect("read");
    let frame = [gaussian(7), gaussian(8)];
    pipe.write_all(bytemuck::cast_slice(&frame)).expect("read");
    drop(pipe);
    let output = child.wait_with_output().expect("its end");
    assert!(output.status.success(), "{}", output.status);
    assert_eq!(
        String::from_utf8_lossy(&output.stdout),
        "step 1099511627776 at 0.25 s: 2\n1.5 200 0.125 7 1\n1.5 200 0.125 8 1\n"
    );
}

#[test]
fn a_c_program_reads_a_frame_by_the_header() {
    reads_a_frame("cc", "-std=c11", "c");
}

#[test]
fn a_cpp_program_reads_a_frame_by_the_header() {
    reads_a_frame("g++", "-std=c++11", "cpp");
}
