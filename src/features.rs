//! `cosplat features`: networks that a user brings make maps, masks and vectors of words.

use std::{num::NonZero, path::PathBuf, time::Duration};

use anyhow::ensure;
use cosplat_features::{
    job::{Job, Progress},
    words::TextEncoder,
};
use cosplat_semantics::query::NEGATIVES;

use crate::{note, progress, say, threads};
use cosplat_console::output;

/// Run networks of your own, as ONNX files: pictures to maps of features and masks, words to vectors.
#[derive(clap::Args)]
pub struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    Pictures(PicturesArgs),
    Words(WordsArgs),
}

/// Make a map of features of every picture, or masks with a vector for each, as `cosplat lift` reads them. What is there already is
/// not made again.
#[derive(clap::Args)]
struct PicturesArgs {
    /// Folder of pictures (.png, .jpg).
    pictures: PathBuf,
    /// TOML file beside an image encoder; its results go to a folder of the file's name. May be given more than once.
    #[arg(long, value_name = "FILE.toml", required = true)]
    image: Vec<PathBuf>,
    /// TOML file beside a network that proposes masks: each mask gets the mean of the map over its pixels.
    #[arg(long, value_name = "FILE.toml")]
    masks: Option<PathBuf>,
    /// Folder for the results.
    #[arg(short, long, value_name = "DIR")]
    out: PathBuf,
    /// Pictures at once; each keeps a network's numbers in memory; 0 means one per processor.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = threads)]
    threads: usize,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// Make a file of vectors of words, as `cosplat objects find` reads it.
#[derive(clap::Args)]
struct WordsArgs {
    /// The words; those that stand for anything come with them.
    #[arg(required = true)]
    words: Vec<String>,
    /// TOML file beside a text encoder that has the tokens of CLIP.
    #[arg(long, value_name = "FILE.toml")]
    text: PathBuf,
    /// The text of a word, which stands at {}.
    #[arg(long, default_value = "a photo of a {}", value_name = "TEXT")]
    prompt: String,
    /// The file.
    #[arg(short, long, value_name = "FILE.safetensors")]
    out: PathBuf,
}

/// Runs the command.
///
/// # Errors
/// When a network or a picture cannot be read, or a result cannot be written.
pub fn run(args: &Args) -> anyhow::Result<()> {
    match &args.command {
        Command::Pictures(args) => pictures(args),
        Command::Words(args) => words(args),
    }
}

fn pictures(args: &PicturesArgs) -> anyhow::Result<()> {
    let masks = args.masks.as_deref();
    let job = Job::new(&args.pictures, &args.image, masks, &args.out)?;
    let threads = match args.threads {
        0 => std::thread::available_parallelism().map_or(1, NonZero::get),
        threads => threads,
    };
    let bar = progress::bar("pictures", job.len() as u64);
    let report = |progress: Progress| match progress {
        Progress::Estimate { left, time } if left > 0 => {
            let time = clock(time);
            bar.suspend(|| note!("{left} more pictures on {threads} threads: about {time}"));
        }
        Progress::Estimate { .. } => {}
        Progress::Done { name } => {
            bar.inc(1);
            bar.set_message(output::plain(&name).into_owned());
        }
    };
    let summary = job.run(threads, &report)?;
    bar.finish_and_clear();
    let each = summary.busy.as_secs_f64() / summary.done.max(1) as f64;
    if args.json {
        let found = serde_json::json!({
            "done": summary.done, "before": summary.before, "seconds_each": each, "out": args.out,
        });
        return say!("{found}");
    }
    say!(
        "{} pictures, {} of them before; {each:.2} s for each; {}",
        summary.done + summary.before,
        summary.before,
        args.out.display()
    )
}

/// Hours, minutes and seconds, rounded up.
fn clock(time: Duration) -> String {
    let seconds = time.as_secs_f64().ceil() as u64;
    let (hours, minutes) = (seconds / 3600, seconds / 60 % 60);
    format!("{hours}:{minutes:02}:{:02}", seconds % 60)
}

fn words(args: &WordsArgs) -> anyhow::Result<()> {
    ensure!(
        args.prompt.contains("{}"),
        "--prompt is {:?}, expected {{}} where the word stands",
        args.prompt
    );
    cosplat_files::keep_apart(&args.out, [&args.text])?;
    let encoder = TextEncoder::load(&args.text)?;
    let mut words = args.words.clone();
    words.extend(NEGATIVES.map(str::to_owned));
    let found = encoder.words(&words, &args.prompt)?;
    found.write(&args.out)?;
    say!(
        "{} words of {} values; {}",
        found.vector.len(),
        found.dim,
        args.out.display()
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_rounded_up() {
        let of = |seconds| clock(Duration::from_secs_f64(seconds));
        assert_eq!(
            [of(0.2), of(61.0), of(7325.5)],
            ["0:00:01", "0:01:01", "2:02:06"]
        );
    }
}
