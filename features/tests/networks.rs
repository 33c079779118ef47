//! Networks with random weights against ONNX Runtime, pictures against Pillow: `make.py` wrote both.

use std::path::{Path, PathBuf};

use cosplat_features::{
    FeaturesError,
    encoder::Encoder,
    job::{Job, Progress, Summary},
    network::Worker,
    picture::Picture,
    proposals::Proposer,
    words::TextEncoder,
};
use cosplat_semantics::{dense, masks, npy};

fn fixture(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/networks");
    folder.join(name)
}

fn floats(name: &str) -> npy::Array<f32> {
    npy::floats(&std::fs::read(fixture(name)).expect("a file")).expect("an array")
}

/// The largest deviation, over the largest value.
fn deviation(found: &[f32], expected: &[f32]) -> f32 {
    assert_eq!(found.len(), expected.len());
    let pairs = found.iter().zip(expected);
    let apart = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    apart / expected.iter().map(|v| v.abs()).fold(0.0, f32::max)
}

fn picture() -> Picture {
    Picture::read(&fixture("picture.png")).expect("a picture")
}

#[test]
fn an_encoder_gives_what_onnx_runtime_gives() {
    let encoder = Encoder::load(&fixture("vit.toml")).expect("an encoder");
    let map = encoder.map(&Worker::default(), &picture()).expect("a map");
    let expected = floats("vit.npy");
    assert_eq!([map.rows, map.columns, map.vectors.dim], *expected.shape);
    let apart = deviation(&map.vectors.value, &expected.value);
    println!("vit: {apart:e} of the largest value");
    // The bar of issue 22; sums of 128 products in another order differ by some 1e-6.
    assert!(apart < 1e-4, "{apart}");
}

#[test]
fn masks_and_their_vectors_are_those_of_numpy() {
    let proposer = Proposer::load(&fixture("masks.toml")).expect("a proposer");
    let encoder = Encoder::load(&fixture("vit.toml")).expect("an encoder");
    let worker = Worker::default();
    let found = proposer.masks(&worker, &picture()).expect("masks");
    let levels = found.levels().map(|map| map.mask).concat();
    let bytes = std::fs::read(fixture("masks_s.npy")).expect("a file");
    let expected = npy::ints(&bytes).expect("an array");
    assert_eq!(expected.shape, [4, found.height, found.width]);
    assert_eq!(levels, expected.value);
    let pooled = found.pooled(&encoder.map(&worker, &picture()).expect("a map"));
    let expected = floats("masks_f.npy");
    assert_eq!([found.masks.len(), pooled.dim], *expected.shape);
    // As above: the vectors come of the map.
    let apart = deviation(&pooled.value, &expected.value);
    assert!(apart < 1e-4, "{apart}");
}

/// A tall picture in an input that is wide: maps and masks are those of the part that it covers.
#[test]
fn a_padded_picture_has_the_maps_and_masks_of_its_part() {
    let worker = Worker::default();
    let tall = Picture::read(&fixture("tall.png")).expect("a picture");
    let encoder = Encoder::load(&fixture("vit_padded.toml")).expect("an encoder");
    let map = encoder.map(&worker, &tall).expect("a map");
    let expected = floats("vit_padded.npy");
    assert_eq!([map.rows, map.columns, map.vectors.dim], *expected.shape);
    let apart = deviation(&map.vectors.value, &expected.value);
    assert!(apart < 1e-4, "{apart}");
    let proposer = Proposer::load(&fixture("masks_padded.toml")).expect("a proposer");
    let found = proposer.masks(&worker, &tall).expect("masks");
    let bytes = std::fs::read(fixture("masks_padded.npy")).expect("a file");
    let expected = npy::ints(&bytes).expect("an array");
    assert_eq!([found.height, found.width], *expected.shape);
    assert_eq!(found.levels()[0].mask, expected.value);
    // Stretched, it is another picture.
    let stretched = Encoder::load(&fixture("vit.toml")).expect("an encoder");
    let map = stretched.map(&worker, &tall).expect("a map");
    assert_eq!([map.rows, map.columns], [6, 8]);
}

#[test]
fn a_text_has_the_tokens_of_clip() {
    let encoder = TextEncoder::load(&fixture("text.toml")).expect("an encoder");
    let tokens = encoder.tokens("A photo of a cat").expect("tokens");
    // As the documentation of transformers has them.
    assert_eq!(tokens[..8], [49406, 320, 1125, 539, 320, 2368, 49407, 0]);
    assert_eq!(tokens.len(), 77);
    let found = encoder.words(&["cat".to_owned()], "a photo of a {}");
    let apart = deviation(
        &found.expect("vectors").vector["cat"],
        &floats("text.npy").value,
    );
    assert!(apart < 1e-4, "{apart}");
    let long = "cat ".repeat(76);
    let error = encoder.tokens(&long).expect_err("too long").to_string();
    assert!(error.contains("78 tokens"), "{error}");
    assert!(error.ends_with("expected at most 77"), "{error}");
}

#[test]
fn pictures_are_those_of_pillow() {
    let of = |picture: &Picture| picture.level.as_flattened().to_vec();
    for (name, width, height) in [("smaller.npy", 20, 12), ("wider.npy", 70, 20)] {
        let found = picture().stretched(width, height);
        // Pillow keeps its weights in 32 bits too.
        let apart = deviation(found.as_flattened(), &floats(name).value);
        assert!(apart < 1e-5, "{name}: {apart}");
    }
    let found = Picture::read(&fixture("picture.jpg")).expect("a picture");
    let bytes = std::fs::read(fixture("jpeg.npy")).expect("a file");
    let expected = npy::ints(&bytes).expect("an array");
    let expected: Vec<f32> = expected.value.iter().map(|v| *v as f32 / 255.0).collect();
    // Decoders may round each of the transform, the colour and its smoothing their own way: a level or two each.
    let apart = deviation(&of(&found), &expected);
    assert!(apart < 4.5 / 255.0, "{apart}");

    let folder = tempfile::tempdir().expect("a folder");
    for (name, of) in [("half.png", "picture.png"), ("half.jpg", "picture.jpg")] {
        let bytes = std::fs::read(fixture(of)).expect("a file");
        let path = folder.path().join(name);
        std::fs::write(&path, &bytes[..bytes.len() / 2]).expect("written");
        let error = Picture::read(&path).expect_err("half of it").to_string();
        assert!(error.contains("damaged"), "{error}");
    }
}

#[test]
fn networks_that_do_not_fit_are_refused_in_a_sentence() {
    let folder = tempfile::tempdir().expect("a folder");
    let config = folder.path().join("vit.toml");
    let text = std::fs::read_to_string(fixture("vit.toml")).expect("a file");
    std::fs::copy(fixture("vit.onnx"), folder.path().join("vit.onnx")).expect("copied");
    let refused = |from: &str, to: &str| {
        let text = text.replace(from, to);
        std::fs::write(&config, text).expect("written");
        let found = Encoder::load(&config).and_then(|e| e.map(&Worker::default(), &picture()));
        found.expect_err(to).to_string()
    };
    let error = refused("\"tokens\"", "\"features\"");
    assert!(
        error.contains("no output \"features\", expected one of tokens"),
        "{error}"
    );
    let error = refused("patch = 8", "patch = 8\ninput = \"image\"");
    assert!(
        error.contains("no input \"image\", expected one of pixels"),
        "{error}"
    );
    let error = refused("patch = 8", "patch = 4");
    assert!(
        error.contains("has 49 tokens, expected at least 12 x 16 patches"),
        "{error}"
    );
    let error = refused("patch = 8\n", "");
    assert!(error.contains("a patch is needed"), "{error}");
    let error = refused("[64, 48]", "[32, 48]");
    assert!(error.contains("does not run"), "{error}");
    let error = refused("\"image\"", "\"text\"\ntokens = 9");
    assert!(error.contains("unknown field"), "{error}");
    std::fs::write(folder.path().join("vit.onnx"), b"\x80\x02pickle").expect("written");
    let error = refused("", "");
    assert!(error.contains("no network that can be run"), "{error}");
    let other = Proposer::load(&fixture("vit.toml"))
        .err()
        .expect("another kind");
    assert!(
        other
            .to_string()
            .contains("kind is \"image\", expected \"masks\"")
    );
}

/// A folder with three pictures.
fn pictures() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    for name in ["a.png", "b.png", "c.jpg"] {
        let of = format!("picture.{}", &name[2..]);
        std::fs::copy(fixture(&of), folder.path().join(name)).expect("copied");
    }
    folder
}

#[test]
fn a_job_goes_on_where_it_ended_and_threads_change_nothing() {
    let (folder, out) = (pictures(), tempfile::tempdir().expect("a folder"));
    let job = |out: &Path| {
        let encoders = [fixture("vit.toml")];
        Job::new(folder.path(), &encoders, None, out).expect("a job")
    };
    let told = std::sync::Mutex::new(Vec::new());
    let tell = |progress: Progress| told.lock().expect("a list").push(progress);
    let summary = job(out.path()).run(1, &tell).expect("done");
    assert_eq!((summary.done, summary.before), (3, 0));
    let said = std::mem::take(&mut *told.lock().expect("a list"));
    // The first one is done alone: by its time the others are estimated before they begin.
    assert!(
        matches!(said[1], Progress::Estimate { left: 2, .. }),
        "{said:?}"
    );
    let written = |name: &str| std::fs::read(out.path().join("vit").join(name)).expect("a map");
    let before = ["a.npy", "b.npy", "c.npy"].map(written);
    assert_eq!(before[0], before[1], "of one picture");

    std::fs::remove_file(out.path().join("vit/b.npy")).expect("removed");
    let summary = job(out.path()).run(2, &tell).expect("done");
    assert_eq!((summary.done, summary.before), (1, 2));
    let again = tempfile::tempdir().expect("a folder");
    job(again.path()).run(3, &tell).expect("done");
    for (name, bytes) in ["a.npy", "b.npy", "c.npy"].iter().zip(before) {
        assert_eq!(written(name), bytes, "{name}");
        let other = std::fs::read(again.path().join("vit").join(name));
        assert_eq!(other.expect("a map"), bytes, "{name} on three threads");
    }
    let all = job(out.path()).run(2, &tell).expect("done");
    let nothing = Summary {
        before: 3,
        ..Summary::default()
    };
    assert_eq!(all, nothing);
    assert!(!out.path().join("vit/.part").exists());
}

#[test]
fn results_are_what_lifting_reads() {
    let (folder, out) = (pictures(), tempfile::tempdir().expect("a folder"));
    let encoders = [fixture("vit.toml")];
    let with_masks = Job::new(
        folder.path(),
        &encoders,
        Some(&fixture("masks.toml")),
        out.path(),
    );
    with_masks.expect("a job").run(2, &|_| ()).expect("done");
    let path = masks::find(&out.path().join("vit"), "a").expect("masks");
    assert!(masks::is_proposals(&path));
    for level in 0..4 {
        let (map, vectors) = masks::read_proposals(&path, level).expect("masks");
        assert_eq!((map.width, map.height, vectors.dim), (32, 24, 32));
    }
    // Results of other networks are not mixed with these.
    let alone = || Job::new(folder.path(), &encoders, None, out.path()).expect("a job");
    let error = alone().run(2, &|_| ()).expect_err("another").to_string();
    assert!(
        error.contains("with masks") && error.contains("another folder"),
        "{error}"
    );
    std::fs::remove_dir_all(out.path().join("vit")).expect("removed");
    alone().run(2, &|_| ()).expect("done");
    let path = dense::find(&out.path().join("vit"), "c").expect("a map");
    let map = dense::read(&path).expect("a map");
    assert_eq!([map.rows, map.columns, map.vectors.dim], [6, 8, 32]);
}

#[test]
fn a_damaged_picture_ends_a_job_and_keeps_the_others() {
    let (folder, out) = (pictures(), tempfile::tempdir().expect("a folder"));
    std::fs::write(folder.path().join("d.png"), b"\x89PNG no more").expect("written");
    let encoders = [fixture("vit.toml")];
    let job = || Job::new(folder.path(), &encoders, None, out.path());
    let error = job().expect("a job").run(1, &|_| ()).expect_err("damaged");
    assert!(matches!(error, FeaturesError::Picture { .. }), "{error}");
    std::fs::remove_file(folder.path().join("d.png")).expect("removed");
    let summary = job().expect("a job").run(1, &|_| ()).expect("done");
    assert_eq!((summary.done, summary.before), (0, 3));

    let refused = |job: Result<Job, FeaturesError>| job.err().expect("refused").to_string();
    std::fs::copy(fixture("picture.png"), folder.path().join("c.png")).expect("copied");
    assert!(refused(job()).contains("both called \"c\""));
    let twice = [encoders[0].clone(), encoders[0].clone()];
    std::fs::remove_file(folder.path().join("c.png")).expect("removed");
    let found = Job::new(folder.path(), &twice, None, out.path());
    assert!(refused(found).contains("would mix"));
    let none = tempfile::tempdir().expect("a folder");
    assert!(refused(Job::new(none.path(), &encoders, None, out.path())).contains("no pictures"));
}
