//! Strokes by mouse in the page of `cosplat objects pick --web`: in a real browser, and past it.

use cosplat_scene::assets::ply;
use cosplat_semantics::{View, transforms};
use glam::{Mat3, Vec3};
use serde_json::{Value, json};

use crate::browser::Browser;
use crate::objects::tower;
use crate::stage::{Process, Stage, watchdog};
use crate::web::{Answer, Page, small_files};

/// Places on the sides of the lower and the upper box of the tower, all of which the first picture shows.
const LOW: [[f64; 3]; 2] = [[0.15, 0.12, 0.05], [0.15, 0.2, -0.05]];
const HIGH: [[f64; 3]; 2] = [[0.1, 0.36, 0.0], [0.1, 0.44, 0.0]];

/// The page of a tower, and its process.
fn page(more: &[&str]) -> (Page, Process) {
    let stage = Stage::new();
    std::fs::write(stage.path("tower.ply"), ply::write(&tower().0)).expect("written");
    let mut all = vec!["objects", "pick", "tower.ply", "--web"];
    all.extend(more);
    let mut process = Process::start(stage.cosplat(&all));
    let link = process.wait_for_output("\n");
    (Page::at(stage, link.trim()), process)
}

/// The pixel of the page at which a point is seen.
fn pixel(browser: &Browser, point: [f64; 3]) -> [i64; 2] {
    let at = browser.script(&format!("return cosplat.pixelOf({point:?})"));
    [0, 1].map(|axis| at[axis].as_f64().expect("a pixel").floor() as i64)
}

/// Draws a line between two points of the tower, in the name that is typed before; gives its pixels.
fn draws(browser: &Browser, name: &str, [from, to]: [[f64; 3]; 2]) -> [[i64; 2]; 2] {
    let name = json!(name);
    let before = browser.script("return cosplat.strokes.length");
    browser.script(&format!(
        "document.getElementById('name').value = {name}; return 0"
    ));
    let [[x, y], [u, v]] = [from, to].map(|point| pixel(browser, point));
    browser.pointer(&[("move", x, y), ("down", 0, 0), ("move", u, v), ("up", 0, 0)]);
    browser.wait_for(&format!(
        "return cosplat.strokes.length === {before} + 1 && cosplat.isCurrent"
    ));
    [[x, y], [u, v]]
}

fn clicks(browser: &Browser, button: &str) {
    browser.script(&format!(
        "document.getElementById('{button}').click(); return 0"
    ));
}

/// How many Gaussians the page says an object has.
fn size(browser: &Browser, name: &str) -> f64 {
    let found = browser.script(&format!(
        "return cosplat.objects.find((o) => o.name === {})?.gaussians ?? 0",
        json!(name)
    ));
    found.as_f64().expect("a count")
}

/// A `transforms.json` with the camera of the page, named `page`.
fn write_camera(browser: &Browser, stage: &Stage) {
    let view = browser.script("return cosplat.view()");
    let vector =
        |v: &Value| Vec3::from_array([0, 1, 2].map(|a| v[a].as_f64().expect("a number") as f32));
    let number = |name: &str| view[name].as_f64().expect("a number") as f32;
    let (width, height) = (number("width"), number("height"));
    let camera = cosplat_renderer::camera::Camera {
        position: vector(&view["position"]),
        world_from_camera: Mat3::from_cols(
            vector(&view["right"]),
            vector(&view["down"]),
            vector(&view["forward"]),
        ),
        focal: [number("focal"); 2],
        center: [0.5 * width, 0.5 * height],
        width: width as u32,
        height: height as u32,
        near: number("near"),
    };
    let views = [View {
        name: "page".into(),
        camera,
    }];
    std::fs::write(stage.path("page.json"), transforms::write(&views)).expect("written");
}

/// What the page writes is what the command line writes: with the strokes that the page prints, and with its pixels in its
/// camera.
#[test]
fn strokes_in_a_browser_part_a_tower_as_the_command_does() {
    let _watchdog = watchdog();
    let (page, mut process) = page(&[]);
    let Some(browser) = Browser::open(&page.link()) else {
        return;
    };
    browser.wait_for("return cosplat.isCurrent && cosplat.objects.length === 2");
    let whole = size(&browser, "object_1");
    let low = draws(&browser, "low", LOW);
    assert_eq!(
        (size(&browser, "low"), size(&browser, "object_1")),
        (whole, 0.0)
    );
    let high = draws(&browser, "high", HIGH);
    let (of_low, of_high) = (size(&browser, "low"), size(&browser, "high"));
    assert!(
        of_low > 0.5 * whole && of_high > 0.2 * whole,
        "{of_low}, {of_high} of {whole}"
    );
    assert_eq!(of_low + of_high, whole);
    let (gaussians, labels) = ("cosplat.state.count", "cosplat.state.paint");
    let shown = browser.script(&format!(
        "const n = cosplat.objects.findIndex((o) => o.name === 'high') + 1;
         let count = 0;
         for (let i = 0; i < {gaussians}; i++) count += {labels}[2 * i + 1] === n;
         return count"
    ));
    assert_eq!(shown.as_f64(), Some(of_high));

    clicks(&browser, "undo");
    browser.wait_for("return cosplat.strokes.length === 1 && cosplat.isCurrent");
    assert_eq!(size(&browser, "low"), whole);
    clicks(&browser, "redo");
    browser.wait_for("return cosplat.strokes.length === 2 && cosplat.isCurrent");

    let file = page.stage.path("tower.objects.safetensors");
    assert!(!file.exists(), "nothing is written before Save");
    clicks(&browser, "save");
    browser.wait_for(
        "return document.getElementById('message').textContent.includes('3 objects saved')",
    );
    let saved = std::fs::read(&file).expect("the file of objects");

    let printed = process.wait_for_output("--stroke 'high:");
    let printed =
        printed.lines().last().unwrap_or_default().to_owned() + &process.wait_for_output("\n");
    let strokes: Vec<&str> = printed
        .trim()
        .split('\'')
        .filter(|part| part.contains(':'))
        .collect();
    assert_eq!(strokes.len(), 2, "{printed}");
    let pick = |out: &str, strokes: [&str; 2], more: &[&str]| {
        let mut line = vec!["objects", "pick", "tower.ply", "--out", out, "--json"];
        line.extend(["--stroke", strokes[0], "--stroke", strokes[1]]);
        line.extend(more);
        Process::start(page.stage.cosplat(&line)).result();
        std::fs::read(page.stage.path(out)).expect("a file of objects")
    };
    assert!(pick("printed.safetensors", [strokes[0], strokes[1]], &[]) == saved);
    write_camera(&browser, &page.stage);
    let center = |x: i64| x as f64 + 0.5;
    let of_view = |name: &str, line: [[i64; 2]; 2]| {
        let points = line.map(|[x, y]| format!("{},{}", center(x), center(y)));
        format!("{name}@page:{}", points.join(" "))
    };
    let strokes = [of_view("low", low), of_view("high", high)];
    let seen = pick(
        "seen.safetensors",
        [&strokes[0], &strokes[1]],
        &["--views", "page.json"],
    );
    assert!(
        seen == saved,
        "another file from pixels of the page's camera"
    );

    draws(&browser, "mid", LOW);
    browser.script("document.getElementById('name').value = 'a:b'; return 0");
    let [x, y] = pixel(&browser, HIGH[0]);
    browser.pointer(&[("move", x, y), ("down", 0, 0), ("up", 0, 0)]);
    browser.wait_for(
        "return document.getElementById('message').textContent.includes('without a colon')",
    );
    assert_eq!(browser.script("return cosplat.strokes.length"), json!(3));
    let log = browser.post("/se/log", &json!({ "type": "browser" }));
    let errors = log.as_array().expect("a log").iter();
    // The refusal is one by its status.
    let errors: Vec<_> = errors
        .filter(|e| e["level"] == "SEVERE" && !e.to_string().contains("422"))
        .collect();
    assert!(errors.is_empty(), "{errors:?}");
}

#[test]
fn strokes_of_who_is_not_the_page_write_nothing() {
    let _watchdog = watchdog();
    let (page, _process) = page(&[]);
    assert!(small_files(&page) >= 8);
    let body =
        json!({ "strokes": [{ "name": "low", "gaussians": [6000] }], "save": true }).to_string();
    let request = |line: &str, more: &[&str], body: &str| {
        let mut lines = vec![format!("{line} HTTP/1.1")];
        lines.extend(more.iter().map(|l| (*l).to_owned()));
        lines.push(format!("content-length: {}", body.len()));
        let Answer(status, head, _) = page.raw(&lines, body);
        assert!(!head.contains("access-control"), "{head}");
        status
    };
    let (host, token) = (
        format!("host: {}", page.host),
        format!("x-cosplat-token: {}", page.token),
    );
    let (ours, shown) = (host.as_str(), token.as_str());
    let wrong = format!("x-cosplat-token: {}", "0".repeat(32));
    let cases: &[(&str, &[&str], u16)] = &[
        ("POST /strokes", &[shown], 403),
        ("POST /strokes", &["host: evil.example", shown], 403),
        (
            "POST /strokes",
            &[ours, "origin: http://evil.example", shown],
            403,
        ),
        (
            "POST /strokes",
            &[ours, "sec-fetch-site: cross-site", shown],
            403,
        ),
        (
            "OPTIONS /strokes",
            &[ours, "access-control-request-method: POST"],
            403,
        ),
        ("POST /strokes", &[ours], 401),
        ("POST /strokes", &[ours, &wrong], 401),
        ("GET /strokes", &[ours, shown], 405),
        ("PUT /strokes", &[ours, shown], 405),
        ("POST /scene", &[ours, shown], 405),
        // Orders are of the other page.
        ("POST /command", &[ours, shown], 404),
        ("GET /main.js", &[ours], 401),
    ];
    for (line, more, expected) in cases {
        assert_eq!(request(line, more, &body), *expected, "{line} {more:?}");
    }
    let line = json!({ "name": "low", "position": [0, 0, 0], "axes": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "focal": 100,
        "size": [100, 100], "near": 0.01, "points": [[50, 50]] });
    let crooked = |key: &str, value: Value| {
        let mut line = line.clone();
        line[key] = value;
        json!({ "line": line, "save": true }).to_string()
    };
    let bodies = [
        ("{".into(), 400),
        ("{\"path\":\"elsewhere\"}".into(), 400),
        (" ".repeat(1 << 20) + "{}", 413),
        (
            json!({ "strokes": [{ "name": "low", "gaussians": [u32::MAX] }], "save": true })
                .to_string(),
            422,
        ),
        (
            json!({ "strokes": [{ "name": "a@b", "gaussians": [0] }], "save": true }).to_string(),
            422,
        ),
        (crooked("focal", json!(-1)), 422),
        (crooked("size", json!([100_000, 100_000])), 422),
        (crooked("points", json!([[1e9, 0]])), 422),
        // A camera that looks away from everything.
        (crooked("position", json!([0, 0, 100])), 422),
    ];
    for (body, expected) in bodies {
        assert_eq!(
            request("POST /strokes", &[ours, shown], &body),
            expected,
            "{body:.80}"
        );
    }
    let file = page.stage.path("tower.objects.safetensors");
    assert!(!file.exists(), "a refused question wrote the file");
    // What the cases vary is what keeps them out.
    assert_eq!(request("POST /strokes", &[ours, shown], &body), 200);
    assert!(file.is_file());
}
