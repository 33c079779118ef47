//! Another user of the machine, who means harm.

use std::{
    fs::{self, Permissions},
    os::unix::{
        fs::{MetadataExt, PermissionsExt, symlink},
        process::CommandExt,
    },
    path::PathBuf,
    process::Command,
};

use cosplat_ipc::{Client, DomainError, ServerPorts, client::ConnectError, server::CreateError};

use super::support::{PATIENCE, TestDomain, send_frame, serve};

/// Somebody who is neither root nor the user that runs the tests.
const STRANGER: u32 = 12345;

/// Whether this process may act as another user; says so, or fails where all is required, if it may not.
fn may_act_as_a_stranger(test: &str) -> bool {
    let is_root = rustix::process::getuid().is_root();
    if !is_root {
        let why = "only root can act as another user";
        assert!(std::env::var_os("COSPLAT_REQUIRE_ALL").is_none(), "{why}");
        eprintln!("SKIPPED: {test}: {why}");
    }
    is_root
}

/// Runs a shell script over `files` as a stranger and returns what it prints.
fn as_a_stranger(script: &str, files: &[PathBuf]) -> String {
    let output = Command::new("sh")
        .args(["-c", script, "sh"])
        .args(files)
        .current_dir("/")
        .uid(STRANGER)
        .gid(STRANGER)
        .output()
        .expect("a shell");
    String::from_utf8(output.stdout).expect("text")
}

/// The domain's management file, the one whose name can be foretold.
fn management_file(domain: &TestDomain) -> PathBuf {
    PathBuf::from(format!(
        "/dev/shm/{}9204dd183d1c4d8e1ff592a30766ffa6765aa8b5_node.0_10_0.global_mgmt",
        domain.prefix()
    ))
}

#[test]
fn another_user_can_touch_nothing_of_a_session() {
    if !may_act_as_a_stranger("another_user_can_touch_nothing_of_a_session") {
        return;
    }
    let domain = TestDomain::new();
    let ports = serve(&domain, "private");
    let shared = fs::read_dir("/dev/shm").expect("shared memory").flatten();
    let mut files: Vec<PathBuf> = shared
        .filter(|file| {
            file.file_name()
                .to_string_lossy()
                .starts_with(domain.prefix())
        })
        .map(|file| file.path())
        .collect();
    assert!(files.contains(&management_file(&domain)));
    files.push(domain.root().join("config/iceoryx2.toml"));
    let attack = r#"for file; do
        cat "$file" > /dev/null && echo "read $file"
        (echo "sixteen letters." > "$file") && echo "wrote $file"
        truncate -s 0 "$file" && echo "emptied $file"
        rm -f "$file" && echo "removed $file"
    done 2> /dev/null"#;
    assert_eq!(as_a_stranger(attack, &files), "");
    let client = Client::connect(&domain, "private", "test", PATIENCE).expect("attached");
    let mut reader = client.frames(1).expect("a reader");
    send_frame(&ports, 1);
    assert!(reader.next(PATIENCE).expect("readable").is_some());
}

#[test]
fn a_file_that_another_user_made_first_is_named() {
    if !may_act_as_a_stranger("a_file_that_another_user_made_first_is_named") {
        return;
    }
    for make in [
        // Readable by all, empty: whoever waited for its content would wait for ever.
        ": > \"$1\" && chmod 666 \"$1\"",
        "echo 'sixteen letters' > \"$1\" && chmod 666 \"$1\"",
        ": > \"$1\" && chmod 200 \"$1\"",
        "ln -s /etc/passwd \"$1\"",
        "mkdir \"$1\"",
    ] {
        let domain = TestDomain::new();
        let file = management_file(&domain);
        as_a_stranger(make, std::slice::from_ref(&file));
        let found = fs::symlink_metadata(&file).expect("the stranger's file");
        assert_eq!(found.uid(), STRANGER, "{make}");
        let client = Client::connect(&domain, "any", "test", PATIENCE);
        let server = ServerPorts::create(&domain, "any", &Default::default());
        let client = client.err().expect("refused");
        assert!(
            matches!(
                &client,
                ConnectError::Domain(DomainError::ForeignFile { owner, .. }) if *owner == STRANGER
            ),
            "{client}"
        );
        let server = server.err().expect("refused");
        assert!(
            matches!(
                &server,
                CreateError::Domain(DomainError::ForeignFile { .. })
            ),
            "{server}"
        );
        for error in [client.to_string(), server.to_string()] {
            assert!(error.contains(&file.display().to_string()), "{error}");
            assert!(error.contains("belongs to user 12345"), "{error}");
        }
        let _ = fs::remove_dir(&file);
    }
}

#[test]
fn a_management_file_that_was_tampered_with_is_replaced() {
    let domain = TestDomain::new();
    let file = management_file(&domain);
    let elsewhere = domain.root().join("elsewhere");
    let write = |content: &str, mode: u32| {
        fs::write(&file, content).expect("written");
        fs::set_permissions(&file, Permissions::from_mode(mode)).expect("permitted");
    };
    let tamper: [&dyn Fn(); 6] = [
        &|| write("", 0o666),
        &|| write("", 0o600),
        &|| write("", 0o200),
        &|| write("sixteen letters.", 0o600),
        // What an older release of cosplat left: others may have it open.
        &|| write("\0\0\u{a}\0\0\0\0\0\0\0\0\0\0\0\0\0", 0o666),
        &|| {
            fs::write(&elsewhere, "untouched").expect("written");
            symlink(&elsewhere, &file).expect("linked");
        },
    ];
    // The folder is there, and the file has been used.
    drop(serve(&domain, "healed"));
    for tamper in tamper {
        fs::remove_file(&file).expect("removed");
        tamper();
        let ports = serve(&domain, "healed");
        let client = Client::connect(&domain, "healed", "test", PATIENCE).expect("attached");
        let found = fs::symlink_metadata(&file).expect("the file");
        assert!(found.is_file());
        assert_eq!((found.mode() & 0o7777, found.len()), (0o600, 16));
        drop((client, ports));
    }
    assert_eq!(
        fs::read_to_string(&elsewhere).expect("readable"),
        "untouched"
    );
}

#[test]
fn an_unfinished_file_of_another_user_holds_nobody_up() {
    if !may_act_as_a_stranger("an_unfinished_file_of_another_user_holds_nobody_up") {
        return;
    }
    let domain = TestDomain::new();
    let name = format!("/dev/shm/{}{:040x}_1.data", domain.prefix(), 7);
    let file = PathBuf::from(name);
    as_a_stranger(
        ": > \"$1\" && chmod 200 \"$1\"",
        std::slice::from_ref(&file),
    );
    let ports = serve(&domain, "unmoved");
    // Waiting for it to go would have ended with its removal.
    assert!(file.exists());
    drop(ports);
}
