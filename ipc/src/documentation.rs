//! The documents say what the code does: their tables are generated here and compared.
//!
//! `COSPLAT_UPDATE_DOCS=1 cargo test -p cosplat-ipc --lib documentation` writes them anew.

use std::{fmt::Write, fs, path::PathBuf};

use crate::{
    Domain, MAX_ROOT_LENGTH,
    schema::{MAX_COMMANDS, WIRE_VERSION, layout, schema_hash},
    session::{
        self, MAX_ACTIVE_REQUESTS, MAX_ATTACHED, MAX_PARTICIPANTS, MAX_SENDERS, MAX_SUBSCRIBERS,
    },
};

fn document(path: &str) -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).join(path)
}

/// Compares what stands between the two marks `name` in a document with `expected`.
fn check(path: &str, name: &str, expected: &str) {
    let file = document(path);
    let text = fs::read_to_string(&file).expect("the document");
    let marks = [
        format!("<!-- begin {name} -->\n"),
        format!("<!-- end {name} -->"),
    ];
    let (head, rest) = text.split_once(&marks[0]).expect("the first mark");
    let (body, tail) = rest.split_once(&marks[1]).expect("the second mark");
    if std::env::var_os("COSPLAT_UPDATE_DOCS").is_some() {
        let new = format!("{head}{}{expected}{}{tail}", marks[0], marks[1]);
        fs::write(&file, new).expect("written");
        return;
    }
    assert_eq!(body, expected, "{path}, {name}");
}

fn layout_tables() -> String {
    let mut text = String::new();
    let mut former = "";
    for row in layout() {
        if row.type_name != former {
            former = row.type_name;
            writeln!(
                text,
                "\n### `{}`: {} bytes, alignment {}\n\n| offset | size | field | type |\n| ---: | ---: | --- | --- |",
                row.type_name, row.type_size, row.type_align
            )
            .expect("text");
        }
        writeln!(
            text,
            "| {} | {} | `{}` | `{}` |",
            row.offset, row.size, row.field, row.field_type
        )
        .expect("text");
    }
    text.push('\n');
    text
}

fn stream_table() -> String {
    let mut text = String::from(
        "| stream | payload | user header | history | queue, at most | held by one reader, at most |\n| --- | --- | --- | ---: | ---: | ---: |\n",
    );
    for (stream, payload, header) in [
        (session::FRAME, "[GaussianState]", "FrameHeader"),
        (session::CHANGES, "[ChangeSlot]", "ChangesHeader"),
        (session::OBJECTS, "[ObjectState]", "ObjectsHeader"),
        (session::CONTACTS, "[Contact]", "ContactsHeader"),
        (session::JOURNAL, "[AppliedCommand]", "JournalHeader"),
        (session::STATUS, "[Status], one element", ""),
        (session::SCENE_GAUSSIANS, "[GaussianRest]", "SceneHeader"),
        (session::SCENE_SH, "[f32]", "SceneHeader"),
        (session::SCENE_OBJECTS, "[ObjectInfo]", "SceneHeader"),
        (session::SCENE_FEATURES, "[f32]", "SceneHeader"),
        (session::SCENE_SOURCE, "[u8]", "SceneHeader"),
        (session::SCENE_FILES, "[SceneFile]", "SceneHeader"),
    ] {
        let header = match header {
            "" => "none".into(),
            name => format!("`{name}`"),
        };
        writeln!(
            text,
            "| `{}` | `{payload}` | {header} | {} | {} | {} |",
            stream.name, stream.history, stream.max_depth, stream.max_held
        )
        .expect("text");
    }
    text
}

fn limit_table() -> String {
    let user = Domain::named("x").expect("a domain");
    let uid = rustix::process::getuid().as_raw().to_string();
    let root = user.root().display().to_string().replace(&uid, "UID");
    let rows = [
        ("wire version", WIRE_VERSION.to_string()),
        ("layout hash", format!("`{:016x}`", schema_hash())),
        ("root folder of the domain `x`", format!("`{root}`")),
        (
            "prefix of its files",
            format!("`{}`", user.prefix().replace(&uid, "UID")),
        ),
        (
            "root path and prefix together",
            format!("{MAX_ROOT_LENGTH} bytes"),
        ),
        ("readers of a stream", MAX_SUBSCRIBERS.to_string()),
        (
            "readers of `hello`, `status` and `scene/...`",
            MAX_ATTACHED.to_string(),
        ),
        ("senders of commands", MAX_SENDERS.to_string()),
        ("participants", MAX_PARTICIPANTS.to_string()),
        (
            "commands in a request or journal message",
            MAX_COMMANDS.to_string(),
        ),
        (
            "unanswered requests of a client",
            MAX_ACTIVE_REQUESTS.to_string(),
        ),
    ];
    let mut text = String::from("| what | value |\n| --- | --- |\n");
    for (what, value) in rows {
        writeln!(text, "| {what} | {value} |").expect("text");
    }
    text
}

#[test]
fn the_wire_format_document_shows_the_layout_of_the_code() {
    check("docs/wire-format.md", "layout", &layout_tables());
    check("docs/wire-format.md", "streams", &stream_table());
    check("docs/wire-format.md", "limits", &limit_table());
}

#[test]
fn the_attach_document_shows_the_examples_as_they_are() {
    for (folder, name, language) in [
        ("ipc/examples", "smallest_subscriber.rs", "rust"),
        ("ipc/examples", "closed_loop.rs", "rust"),
        ("ipc/examples", "subscriber.py", "python"),
        ("clients/python/examples", "frames.py", "python"),
        ("clients/python/examples", "push_to_target.py", "python"),
    ] {
        let example = fs::read_to_string(document(folder).join(name)).expect("an example");
        assert!(example.lines().count() <= 60, "{name} is to stay small");
        let block = format!("```{language}\n{example}```\n");
        check("docs/attach-a-client.md", name, &block);
    }
}
