//! `cosplat objects find`: which objects a word means, by their vectors.

use std::path::PathBuf;

use anyhow::{Context, ensure};
use cosplat_console::say;
use cosplat_semantics::{
    objects::{Objects, Vectors},
    query::{CONTRAST, NEGATIVES, THRESHOLD, Words, alike},
};

use crate::lift::load;

/// Difference of scores that says nothing.
const ALIKE: f32 = 0.01;

/// Say which objects a word means, most relevant first. Objects have vectors where `cosplat lift` was given those of masks.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The splat (.ply or .splat).
    splat: PathBuf,
    /// Its file of objects [default: beside the splat, `NAME.objects.safetensors`].
    #[arg(long, value_name = "FILE")]
    objects: Option<PathBuf>,
    /// Vectors of words, as a text encoder makes them: a safetensors file with an f32 vector for each, by its name.
    #[arg(long, value_name = "FILE", required_unless_present = "like")]
    words: Option<PathBuf>,
    /// The word that is meant.
    #[arg(long, value_name = "WORD", required_unless_present = "like")]
    word: Option<String>,
    /// An object instead of a word: what is like it, by the cosine of vectors.
    #[arg(long, value_name = "NAME", conflicts_with_all = ["words", "word", "softmax"])]
    like: Option<String>,
    /// Words that stand for anything.
    #[arg(long, value_name = "WORDS", value_delimiter = ',', default_values = NEGATIVES)]
    negatives: Vec<String>,
    /// A softmax over this list of words in place of the relevancy, scaled to 0 to 1 over the objects.
    #[arg(long, value_name = "WORDS", value_delimiter = ',')]
    softmax: Vec<String>,
    /// Score above which an object is meant, 0 to 1.
    #[arg(long, default_value_t = THRESHOLD, value_name = "T")]
    threshold: f32,
    /// How far an object that is meant stands out from the others by its cosine with the word [standard deviations]; 0 does not ask.
    /// Fewer than five objects are not asked, nor is a list of words.
    #[arg(long, default_value_t = CONTRAST, value_name = "N", conflicts_with_all = ["like", "softmax"])]
    contrast: f32,
    /// Give the object that is meant most the word for its name; of several that score alike, the largest.
    #[arg(long, conflicts_with = "like")]
    rename: bool,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// Runs the command.
///
/// # Errors
/// When a file cannot be read, or a word or an object has no vector.
pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    ensure!(
        (0.0..=1.0).contains(&args.threshold),
        "--threshold is {}, expected 0 to 1",
        args.threshold
    );
    let (_, found, hash) = load(&args.splat)?;
    let path = args.objects.clone();
    let path = path.unwrap_or_else(|| args.splat.with_extension("objects.safetensors"));
    let mut objects = Objects::read(&path, hash, found.count)?;
    let vectors = objects.object_feature.as_ref().with_context(|| {
        format!(
            "{} has no vectors of objects: lift masks that have some",
            path.display()
        )
    })?;
    ensure!(
        args.contrast >= 0.0,
        "--contrast is {}, expected 0 or more",
        args.contrast
    );
    let (scores, apart) = scores(args, &objects, vectors)?;
    let mut size = vec![0usize; objects.names.len()];
    for object in objects.labels.object.iter().filter(|o| **o >= 0) {
        size[*object as usize] += 1;
    }
    // What has no Gaussian is nothing to be meant.
    let mut order: Vec<usize> = (0..scores.len()).filter(|n| size[*n] > 0).collect();
    order.sort_by(|&a, &b| scores[b].total_cmp(&scores[a]).then(a.cmp(&b)));
    let stands_out = |n: usize| match &apart {
        Some(apart) if args.contrast > 0.0 => apart[n] >= args.contrast,
        _ => true,
    };
    let is_meant = |n: usize| scores[n] > args.threshold && stands_out(n);
    let meant: Vec<usize> = order.iter().copied().filter(|n| is_meant(*n)).collect();
    let said = objects.names.clone();
    let renamed = match &args.word {
        Some(word) if args.rename => rename(&mut objects, word, &meant, &scores, &size)?,
        _ => None,
    };
    if renamed.is_some() {
        objects.write(&path)?;
    }
    if args.json {
        let all = order.iter().map(
            |&n| serde_json::json!({ "name": said[n], "score": scores[n], "contrast": apart.as_ref().map(|a| a[n]), "meant": is_meant(n) }),
        );
        return say!(
            "{}",
            serde_json::json!({ "objects": all.collect::<Vec<_>>(), "threshold": args.threshold, "renamed": renamed.map(|n| &said[n]) })
        );
    }
    for &n in &order {
        let mark = if is_meant(n) { '*' } else { ' ' };
        match &apart {
            Some(apart) => say!("{mark} {:.3}  {:+6.1}  {}", scores[n], apart[n], said[n])?,
            None => say!("{mark} {:.3}  {}", scores[n], said[n])?,
        }
    }
    if args.rename {
        match renamed {
            Some(object) => say!("{} is now {}", said[object], objects.names[object])?,
            None => say!("none is meant: names stay")?,
        }
    }
    say!(
        "{} of {} objects are meant: above {}{}",
        meant.len(),
        order.len(),
        args.threshold,
        match apart {
            Some(_) if args.contrast > 0.0 => format!(", and {} from what is usual", args.contrast),
            _ => String::new(),
        }
    )
}

/// Gives one of the objects that are meant, best first, the word for its name: the largest of those that score as the best one does.
/// A piece of a thing must not take the name from the rest of it.
fn rename(
    objects: &mut Objects,
    word: &str,
    meant: &[usize],
    scores: &[f32],
    size: &[usize],
) -> anyhow::Result<Option<usize>> {
    let Some(best) = meant.first() else {
        return Ok(None);
    };
    let alike = meant.iter().filter(|n| scores[**n] > scores[*best] - ALIKE);
    let largest = alike.max_by_key(|n| (size[**n], std::cmp::Reverse(**n)));
    let named = *largest.unwrap_or(best);
    let other = objects.names.iter().position(|name| name == word);
    ensure!(
        other.is_none_or(|other| other == named),
        "{word:?} is the name of another object already"
    );
    word.clone_into(&mut objects.names[named]);
    Ok(Some(named))
}

/// Scores of the objects, and how far each stands out where that is asked and there are enough.
fn scores(
    args: &Args,
    objects: &Objects,
    vectors: &Vectors,
) -> anyhow::Result<(Vec<f32>, Option<Vec<f32>>)> {
    if let Some(name) = &args.like {
        let example = objects.names.iter().position(|n| n == name);
        let example = example.with_context(|| {
            let known = objects.names.join(", ");
            format!("object {name:?} does not exist, expected one of {known}")
        })?;
        return Ok((alike(vectors, example), None));
    }
    let file = args.words.as_deref().context("--words is missing")?;
    let query = args.word.as_deref().context("--word is missing")?;
    let words = Words::read(file)?;
    ensure!(
        words.dim == vectors.dim,
        "words have {} values, objects {}: they are of different encoders",
        words.dim,
        vectors.dim
    );
    let list = match args.softmax.is_empty() {
        true => &args.negatives,
        false => &args.softmax,
    };
    let list: Vec<&str> = list
        .iter()
        .map(String::as_str)
        .filter(|w| *w != query)
        .collect();
    let found = match args.softmax.is_empty() {
        true => words.relevancy(vectors, query, &list),
        false => words.softmax(vectors, query, &list),
    };
    let apart = match args.softmax.is_empty() {
        true => words.contrast(vectors, query),
        false => None,
    };
    let found = found.with_context(|| {
        let all = list.iter().chain([&query]);
        let missing = all.filter(|w| !words.vector.contains_key(**w));
        let missing: Vec<&str> = missing.copied().collect();
        format!("{} has no vector of {}", file.display(), missing.join(", "))
    })?;
    Ok((found, apart))
}
