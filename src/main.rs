//! The `cosplat` command line: one file per subcommand.

fn main() {}
