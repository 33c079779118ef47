//! What shells and `man` are told of the command line.

use std::{fs, path::PathBuf};

use anyhow::Context;
use clap::Command;
use clap_complete::Shell;
use cosplat_console::say;

/// Print what a shell completes commands and options by.
///
/// bash: `cosplat completions bash > ~/.local/share/bash-completion/completions/cosplat`; zsh: a file `_cosplat` in a folder of `$fpath`;
/// fish: `~/.config/fish/completions/cosplat.fish`.
#[derive(clap::Args)]
pub struct CompletionsArgs {
    /// Shell.
    #[arg(value_enum)]
    shell: Shell,
}

/// Write a manual page of every command: cosplat.1, cosplat-serve.1 and so on.
#[derive(clap::Args)]
pub struct ManualArgs {
    /// Folder for the pages, like ~/.local/share/man/man1; it is made where there is none.
    #[arg(value_name = "DIR")]
    folder: PathBuf,
}

/// Prints completions of a command line.
///
/// # Errors
/// When standard output cannot be written.
pub fn complete(args: &CompletionsArgs, mut command: Command) -> anyhow::Result<()> {
    let mut script = Vec::new();
    let name = command.get_name().to_owned();
    clap_complete::generate(args.shell, &mut command, name, &mut script);
    say!("{}", String::from_utf8(script)?.trim_end())
}

/// Writes the manual pages of a command line.
///
/// # Errors
/// When the folder cannot be made, or a page cannot be written.
pub fn write(args: &ManualArgs, command: Command) -> anyhow::Result<()> {
    let folder = &args.folder;
    let write = || {
        fs::create_dir_all(folder)?;
        clap_mangen::generate_to(command, folder)
    };
    write().with_context(|| format!("cannot write manual pages into {}", folder.display()))
}
