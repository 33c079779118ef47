//! The page's hand: what is picked, held and dragged, in a real browser and without one.

use std::time::{Duration, Instant};

use cosplat_ipc::client::Client;
use cosplat_ipc::schema::{
    AppliedCommand, COMMAND_DRAG, COMMAND_GRAB, COMMAND_IMPULSE_AT, COMMAND_LET_GO, SERVER_PAUSED,
};
use serde_json::{Value, json};

use crate::browser::{Browser, first_camera, gaussians_of, paused_in_browser};
use crate::stage::{PATIENCE, Process, Stage, wait_for_status, watchdog};
use crate::web::{Page, record};

/// Commands of the journal until one of this kind, which comes last.
pub fn journal_until(
    reader: &mut cosplat_ipc::client::JournalReader,
    kind: u32,
) -> Vec<AppliedCommand> {
    let deadline = Instant::now() + PATIENCE;
    let mut seen = Vec::new();
    while Instant::now() < deadline {
        let message = reader.next(Duration::from_millis(100)).expect("a journal");
        seen.extend(message.iter().flat_map(|m| m.items().iter().copied()));
        if seen.last().is_some_and(|last| last.command.kind == kind) {
            return seen;
        }
    }
    panic!("no command of kind {kind}: {seen:?}");
}

/// Waits for a number of steps from now.
fn wait_steps(client: &Client, steps: u64) {
    let now = wait_for_status(client, |_| true).step;
    wait_for_status(client, |s| s.step >= now + steps);
}

fn grab(page: &Page, number: u64, steps: u32) -> Value {
    let figures = page.figures();
    let com = &figures["objects"][0]["com"];
    page.order_of(
        number,
        &json!({ "action": "grab", "object": "left", "point": com, "radius": 1.0, "steps": steps }),
    )
}

#[test]
fn what_a_page_holds_is_let_go_of_when_it_says_no_more() {
    let _watchdog = watchdog();
    let page = Page::open(&[]);
    let client = page.stage.client();
    let drag = json!({ "action": "drag", "object": "left", "to": [0, 0.5, 0] });
    let let_go = json!({ "action": "let-go", "object": "left" });
    assert!(grab(&page, 7, 6000)["refused"].is_null());
    // Another page, and `ctl`, have no part in it.
    assert!(page.order_of(8, &drag)["refused"].is_string());
    assert!(page.order(&drag)["refused"].is_string());
    assert!(page.order_of(7, &drag)["refused"].is_null());
    assert!(page.order_of(7, &let_go)["refused"].is_null());
    // This one is gone after its first order.
    assert!(grab(&page, 7, 20)["refused"].is_null());
    assert!(page.order_of(7, &drag)["refused"].is_null());
    wait_steps(&client, 30);
    let refused = page.order_of(7, &let_go);
    assert!(refused["refused"].is_string(), "{refused}");
    let body = json!({ "order": drag, "page": 0 }).to_string();
    assert_eq!(page.post(&body), 400);
}

/// Pixels of a grid at which the page sees an object, `[x, y, object]` each; -1 for the background.
pub fn seen_by_page(browser: &Browser, step: u32) -> Vec<[i64; 3]> {
    let grid = browser.script(&format!(
        "const c = document.getElementById('view'), all = [];
         for (let y = 3; y < c.height; y += {step}) for (let x = 3; x < c.width; x += {step}) {{
           const seen = cosplat.pick(x + 0.5, y + 0.5);
           all.push([x, y, seen ? cosplat.state.objects[seen.object].id : -1]);
         }}
         return all"
    ));
    let numbers = grid.as_array().expect("pixels").iter();
    numbers
        .map(|row| [0, 1, 2].map(|n| row[n].as_i64().expect("a number")))
        .collect()
}

#[test]
fn the_page_picks_what_ctl_picks_and_drags_what_it_picked() {
    let _watchdog = watchdog();
    let page = Page::open(&[]);
    let Some((browser, client, paused)) = paused_in_browser(&page) else {
        return;
    };
    let gaussians = gaussians_of(&client, paused);
    let size =
        browser.script("const c = document.getElementById('view'); return [c.width, c.height]");
    let [width, height] = [0, 1].map(|n| size[n].as_u64().expect("pixels") as u32);
    let view = first_camera(&client, width, height);
    let pixels = seen_by_page(&browser, 7);
    let differ = pixels.iter().filter(|[x, y, seen]| {
        let at = [*x as f32 + 0.5, *y as f32 + 0.5];
        let ours = cosplat_renderer::pick(&gaussians, &view, at);
        ours.map_or(-1, |picked| i64::from(picked.object)) != *seen
    });
    let differ = differ.count();
    // Sixteen bits of place: the outline of an object moves by less than a hundredth of a pixel.
    assert!(pixels.len() > 1000, "{}", pixels.len());
    assert!(
        differ * 1000 <= pixels.len(),
        "{differ} of {}",
        pixels.len()
    );

    // A press on an object, a drag, and the end of it.
    let held = pixels
        .iter()
        .find(|pixel| pixel[2] == 0)
        .expect("an object is seen");
    let [x, y] = [held[0], held[1]];
    browser.press(" ");
    let mut journal = client.journal().expect("a journal");
    browser.pointer(&[("move", x, y), ("down", 0, 0), ("move", x, y - 40)]);
    browser.wait_for("return !document.getElementById('mark').hasAttribute('hidden')");
    journal_until(&mut journal, COMMAND_DRAG);
    browser.pointer(&[("up", 0, 0)]);
    let end = journal_until(&mut journal, COMMAND_LET_GO);
    let holder = end.last().expect("an order").client;
    assert_ne!(holder, 0);
    assert_eq!(browser.script("return cosplat.panel.selected"), json!(0));

    // Held again by a browser that is killed: heartbeats end, and then the hold.
    browser.script("cosplat.camera.reset(); return 0");
    browser.pointer(&[("move", x, y), ("down", 0, 0), ("move", x + 20, y)]);
    let begun = journal_until(&mut journal, COMMAND_DRAG);
    assert!(
        begun
            .iter()
            .any(|c| c.command.kind == COMMAND_GRAB && c.client == holder)
    );
    drop(browser);
    wait_steps(&client, 150);
    let refused = page.order_of(holder, &json!({ "action": "let-go", "object": "left" }));
    assert!(refused["refused"].is_string(), "{refused}");
}

#[test]
fn a_click_with_the_tool_push_pushes_where_it_hits() {
    let _watchdog = watchdog();
    let page = Page::open(&[]);
    let Some(browser) = Browser::open(&page.link()) else {
        return;
    };
    browser.wait_for("return cosplat.pictures > 1 && cosplat.state.figures !== null");
    browser.press("h");
    let client = page.stage.client();
    let mut journal = client.journal().expect("a journal");
    browser.press(" ");
    let paused = wait_for_status(&client, |s| s.server_state == SERVER_PAUSED);
    browser.wait_for(&format!("return cosplat.state.step === {}", paused.step));
    let pixels = seen_by_page(&browser, 9);
    let hit = pixels
        .iter()
        .find(|pixel| pixel[2] == 1)
        .expect("it is seen");
    browser.pointer(&[("move", hit[0], hit[1]), ("down", 0, 0), ("up", 0, 0)]);
    browser.wait_for("return cosplat.panel.selected === 1");
    browser.press(".");
    let seen = journal_until(&mut journal, COMMAND_IMPULSE_AT);
    let pushed = seen.last().expect("an order").command;
    assert_eq!(pushed.object, 1);
    assert!(pushed.radius > 0.0 && pushed.vector.iter().any(|x| *x != 0.0));
}

#[test]
fn a_recording_has_a_slider_that_goes_to_any_step() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let path = record(&stage);
    slides(&Page::beside(stage, None, &[&path]));
}

#[test]
fn a_replay_session_has_a_slider_that_goes_to_any_step() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let path = record(&stage);
    let mut replay = Process::start(stage.cosplat(&["replay", &path, "--paused", "--loop"]));
    stage.wait_for_server(&mut replay);
    slides(&Page::beside(stage, Some(replay), &[]));
}

/// Goes to steps by slider and by keys.
fn slides(page: &Page) {
    let Some(browser) = Browser::open(&page.link()) else {
        return;
    };
    browser.wait_for("return cosplat.pictures > 0 && cosplat.state.figures !== null");
    let range = browser.script("return cosplat.state.about.recorded");
    let [first, last] = [0, 1].map(|n| range[n].as_u64().expect("a step"));
    assert!(last >= first + 30, "{range}");
    // Several at once, as from a hand that pulls the slider: the last one counts.
    browser.script(
        "const time = document.getElementById('time');
         for (const step of [5, 9, 20]) { time.value = step; time.dispatchEvent(new Event('input')); }
         return 0",
    );
    browser.wait_for("return cosplat.state.step === 20 && !cosplat.panel.isSeeking");
    browser.press(",");
    browser.wait_for("return cosplat.state.step === 19");
    browser.press(".");
    browser.wait_for("return cosplat.state.step === 20");
    browser.press("r");
    browser.wait_for(&format!("return cosplat.state.step === {first}"));
    browser.press(" ");
    browser.wait_for("return !cosplat.panel.isPaused && cosplat.state.step > 20");
    browser.wait_for("return Number(document.getElementById('time').value) > 20");
    let refused = page.order(&json!({ "action": "gravity", "gravity": [0, 0, 0] }));
    assert!(refused["refused"].is_string(), "{refused}");
}

/// A block that stands on a floor, and sleeps after a while.
const RESTING: &str = r#"
version = 1
name = "rest"
dx = 0.05
[materials.soft]
law = "neo_hookean"
youngs_modulus_pa = 2e5
poisson_ratio = 0.3
density_kg_m3 = 1000
[[objects]]
name = "block"
shape = { kind = "box", size = [0.4, 0.3, 0.4], gaussian_spacing = 0.1 }
translation = [0, 0.15, 0]
material = "soft"
fidelity = "auto"
[[colliders]]
name = "floor"
normal = [0, 1, 0]
surface = "sticky"
"#;

#[test]
fn a_settled_scene_sends_less_than_5_kilobytes_a_second() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let server = stage.serve_scene(RESTING, &["--pace", "realtime"]);
    let page = Page::beside(stage, Some(server), &[]);
    let fidelity = |figures: &Value| figures["objects"][0]["fidelity"].as_u64();
    let deadline = Instant::now() + PATIENCE;
    while fidelity(&page.figures()) != Some(3) {
        assert!(Instant::now() < deadline, "{}", page.figures());
    }
    let (bytes, steps) = page.bytes_of_quiet_answers(4);
    // It is not paused: steps are made. Answers with nothing new come after 250 ms, four a second.
    assert!(steps > 0 && bytes < 5000, "{bytes} bytes in {steps} steps");
}
