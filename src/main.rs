//! The program `cosplat`.

fn main() -> std::process::ExitCode {
    cosplat::main()
}
