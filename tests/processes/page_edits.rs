//! Objects are edited in the page: by numbers, buttons, keys and dragging, in a real browser.

use cosplat_ipc::client::Client;
use cosplat_ipc::schema::{COMMAND_REDO, COMMAND_SET_MATERIAL, COMMAND_SET_POSE, COMMAND_UNDO};
use serde_json::{Value, json};

use crate::browser::{Browser, paused_in_browser};
use crate::hand::{journal_until, seen_by_page};
use crate::stage::{Stage, wait_for_status, watchdog};
use crate::web::Page;

/// WebDriver's number of the key Ctrl.
const CTRL: &str = "\u{e009}";

/// A paused session with a copy that waits, its page and a browser; none without a browser.
fn paused() -> Option<(Page, Browser, Client)> {
    let stage = Stage::new();
    let server = stage.serve_scene(&crate::edits::scene(), &["--pace", "realtime"]);
    let page = Page::beside(stage, Some(server), &[]);
    let (browser, client, _) = paused_in_browser(&page)?;
    Some((page, browser, client))
}

/// Makes one step, and waits until the page has its figures.
fn step(browser: &Browser, client: &Client) {
    let now = wait_for_status(client, |_| true).step;
    browser.press(".");
    wait_for_status(client, |s| s.step == now + 1);
    let is_shown = format!(
        "return cosplat.state.step === {0} && cosplat.state.figures.status.step === {0}",
        now + 1
    );
    browser.wait_for(&is_shown);
}

/// Selects an object and types numbers: a place [m], or a turn [degrees].
fn types(browser: &Browser, object: u32, what: &str, numbers: [f64; 3]) {
    browser.script(&format!(
        "cosplat.panel.select({object});
         {numbers:?}.forEach((value, a) => {{
           const field = document.getElementById('{what}-' + 'xyz'[a]);
           field.value = value;
           field.dispatchEvent(new Event('input'));
         }});
         return 0"
    ));
}

fn clicks(browser: &Browser, button: &str) {
    browser.script(&format!(
        "document.getElementById('{button}').click(); return 0"
    ));
}

fn says(browser: &Browser, words: &str) {
    let words = json!(words);
    browser.wait_for(&format!(
        "return document.getElementById('message').textContent.includes({words})"
    ));
}

/// A figure of an object as the page has it.
fn figure(browser: &Browser, object: u32, name: &str) -> Value {
    browser.script(&format!(
        "return cosplat.state.objects[{object}].figures.{name}"
    ))
}

fn place(browser: &Browser, object: u32) -> [f64; 3] {
    let com = figure(browser, object, "com");
    [0, 1, 2].map(|a| com[a].as_f64().expect("a number"))
}

#[test]
fn fields_show_whole_numbers_and_keep_what_nobody_typed() {
    let _watchdog = watchdog();
    let Some((_page, browser, _client)) = paused() else {
        return;
    };
    let exact = [-2.29e-17, -0.123_456_789_012_345_6, 0.3 + 1e-16];
    let told = browser.script(&format!(
        "const {{ edits }} = cosplat.panel;
         cosplat.panel.select(0);
         document.getElementById('panel').hidden = false;
         cosplat.state.objects[0].figures.com = {exact:?};
         edits.show();
         const fields = ['at-x', 'at-y', 'at-z'].map((id) => document.getElementById(id));
         const shown = fields.map((field) => [field.value, field.scrollWidth - field.clientWidth]);
         fields[1].value = '0.5';
         fields[1].dispatchEvent(new Event('input'));
         const {{ position }} = edits.typed();
         edits.clear();
         return [shown, position]"
    ));
    for (field, exact) in [0, 1, 2].map(|a| (&told[0][a], exact[a])) {
        let text = field[0].as_str().expect("a text");
        let value: f64 = text.parse().expect("a number");
        assert!(
            !text.contains('e') && (value - exact).abs() < 1e-4,
            "{text}"
        );
        assert_eq!(field[1], json!(0), "{text} is cut");
    }
    for (found, expected) in [0, 1, 2].map(|a| (&told[1][a], [exact[0], 0.5, exact[2]][a])) {
        let found = found.as_f64().expect("a number");
        // Readers of JSON may err in the last digit.
        let error = (found - expected).abs();
        assert!(error <= 1e-15 * expected.abs(), "{found}, {expected}");
    }
}

#[test]
fn numbers_and_buttons_edit_and_refusals_are_shown() {
    let _watchdog = watchdog();
    let Some((_page, browser, client)) = paused() else {
        return;
    };
    types(&browser, 0, "at", [0.25, place(&browser, 1)[1], 0.0]);
    clicks(&browser, "move");
    says(&browser, "overlap object 1 by");
    types(&browser, 0, "at", [-0.3, 0.9, 0.1]);
    clicks(&browser, "move");
    says(&browser, "put there as step");
    step(&browser, &client);
    let [x, y, z] = place(&browser, 0);
    // A step of falling, from rest: less than a centimetre.
    assert!(
        (x + 0.3).abs() < 1e-3 && (y - 0.9).abs() < 0.01 && (z - 0.1).abs() < 1e-3,
        "{x} {y} {z}"
    );

    let is_off = "return document.getElementById('bring-in').disabled";
    assert_eq!(browser.script(is_off), json!(true));
    types(&browser, 2, "at", [0.0, 0.3, 0.0]);
    types_turn(&browser);
    assert_eq!(browser.script(is_off), json!(false));
    clicks(&browser, "bring-in");
    says(&browser, "brought in as step");
    step(&browser, &client);
    assert_eq!(figure(&browser, 2, "fidelity"), json!(2));
    assert!((place(&browser, 2)[1] - 0.3).abs() < 0.01);

    browser.script(
        "const list = document.getElementById('model');
         list.value = 'rigid';
         list.dispatchEvent(new Event('change'));
         return 0",
    );
    says(&browser, "modelled as rigid");
    step(&browser, &client);
    assert_eq!(figure(&browser, 2, "fidelity"), json!(4));
    for expected in [json!(2), json!(7)] {
        clicks(&browser, "undo");
        says(&browser, "undone as step");
        step(&browser, &client);
        assert_eq!(figure(&browser, 2, "fidelity"), expected);
    }
    clicks(&browser, "redo");
    says(&browser, "redone as step");
    step(&browser, &client);
    assert_eq!(figure(&browser, 2, "fidelity"), json!(2));
}

/// A turn beside the place that is typed already.
fn types_turn(browser: &Browser) {
    browser.script("document.getElementById('turn-y').value = 45; return 0");
}

#[test]
fn keys_remove_and_undo_and_what_is_gone_is_not_picked() {
    let _watchdog = watchdog();
    let Some((_page, browser, client)) = paused() else {
        return;
    };
    let is_seen = |browser: &Browser| {
        let pixels = seen_by_page(browser, 9);
        pixels.iter().any(|pixel| pixel[2] == 0)
    };
    assert!(is_seen(&browser));
    // A copy that waits is drawn nowhere and seen nowhere.
    assert!(seen_by_page(&browser, 9).iter().all(|pixel| pixel[2] != 2));
    assert_eq!(browser.script("return cosplat.panel.selected"), json!(0));
    browser.press("\u{e017}");
    says(&browser, "removed as step");
    step(&browser, &client);
    assert_eq!(figure(&browser, 0, "fidelity"), json!(7));
    assert!(!is_seen(&browser));

    let mut journal = client.journal().expect("a journal");
    browser.press("u");
    says(&browser, "undone as step");
    step(&browser, &client);
    journal_until(&mut journal, COMMAND_UNDO);
    assert!(is_seen(&browser));
    browser.press("U");
    says(&browser, "redone as step");
    step(&browser, &client);
    journal_until(&mut journal, COMMAND_REDO);
    assert!(!is_seen(&browser));
    browser.key(CTRL, "keyDown");
    browser.press("z");
    browser.key(CTRL, "keyUp");
    says(&browser, "undone as step");
    step(&browser, &client);
    assert!(is_seen(&browser));

    // The preset that undo takes back is the one before.
    let material = "return cosplat.state.objects[0].material";
    let before = browser.script(material);
    browser.press("]");
    says(&browser, "made of");
    assert_ne!(browser.script(material), before);
    browser.press("u");
    says(&browser, "undone as step");
    assert_eq!(browser.script(material), before);
    step(&browser, &client);
    browser.press("u");
    says(&browser, "no edit to undo");
}

#[test]
fn a_drag_with_ctrl_puts_an_object_elsewhere() {
    let _watchdog = watchdog();
    let Some((_page, browser, client)) = paused() else {
        return;
    };
    let pixels = seen_by_page(&browser, 7);
    let mut own = pixels.iter().filter(|pixel| pixel[2] == 0);
    let held = own.clone().nth(own.clone().count() / 2).or(own.next());
    let [x, y, _] = *held.expect("an object is seen");
    let before = place(&browser, 0);
    let mut journal = client.journal().expect("a journal");
    let steps = wait_for_status(&client, |_| true).step;

    browser.key(CTRL, "keyDown");
    browser.pointer(&[("move", x, y), ("down", 0, 0), ("move", x - 30, y + 10)]);
    // It is shown where the hand is while the session knows nothing of it.
    browser.wait_for("return cosplat.state.objects[0].shift.some((x) => x !== 0)");
    let shift = browser.script("return cosplat.state.objects[0].shift");
    let shift = [0, 1, 2].map(|a| shift[a].as_f64().expect("a number"));
    assert!(
        shift[1].abs() < 1e-9,
        "a drag keeps the height, not {shift:?}"
    );
    browser.pointer(&[("up", 0, 0)]);
    browser.key(CTRL, "keyUp");
    says(&browser, "put there as step");
    assert_eq!(wait_for_status(&client, |_| true).step, steps);
    step(&browser, &client);
    let ordered = journal_until(&mut journal, COMMAND_SET_POSE);
    let target = ordered.last().expect("an order").command.vector;
    for a in 0..3 {
        // The page knows the place to four digits.
        assert!((target[a] - before[a] - shift[a]).abs() < 1e-6);
        assert!((place(&browser, 0)[a] - target[a]).abs() < 0.01);
    }
    let settled = browser.script("return cosplat.state.objects[0].shift");
    assert_eq!(settled, json!([0, 0, 0]));

    // By the tool, into the floor: refused, and shown where it is.
    browser.script("cosplat.panel.tool('move'); return 0");
    let pixels = seen_by_page(&browser, 7);
    let held = pixels.iter().find(|pixel| pixel[2] == 0);
    let [x, y, _] = *held.expect("an object is seen");
    browser.pointer(&[("move", x, y), ("down", 0, 0)]);
    browser.key("\u{e008}", "keyDown");
    let height = browser.script("return document.getElementById('view').clientHeight");
    let lowest = height.as_i64().expect("pixels") - 5;
    browser.pointer(&[("move", x, lowest), ("up", 0, 0)]);
    browser.key("\u{e008}", "keyUp");
    says(&browser, "overlap collider 0 by");
    browser.wait_for("return cosplat.state.objects[0].shift.every((x) => x === 0)");
}

#[test]
fn a_drag_with_the_brush_paints_what_is_below_it() {
    let _watchdog = watchdog();
    let Some((_page, browser, client)) = paused() else {
        return;
    };
    let pixels = seen_by_page(&browser, 7);
    let own: Vec<_> = pixels.iter().filter(|pixel| pixel[2] == 0).collect();
    let [x, y, _] = *own[own.len() / 2];
    let mut journal = client.journal().expect("a journal");
    browser.script(
        "cosplat.panel.tool('paint');
         const list = document.getElementById('preset');
         list.value = 'packed_snow';
         list.dispatchEvent(new Event('change'));
         document.getElementById('patch').value = 0.2;
         return 0",
    );
    browser.pointer(&[("move", x, y), ("down", 0, 0)]);
    says(&browser, "painted with packed_snow as step");
    browser.pointer(&[("up", 0, 0)]);
    step(&browser, &client);
    let seen = journal_until(&mut journal, COMMAND_SET_MATERIAL);
    let painted = seen.last().expect("an order").command;
    // Law 5 is snow; the patch is a fifth of the object's radius.
    assert_eq!((painted.object, painted.material.law), (0, 5));
    assert!(painted.radius > 0.0 && painted.point != [0.0; 3]);
    // The page still says what the object is made of, and undo takes the stroke back.
    browser.press("u");
    says(&browser, "undone as step");
    step(&browser, &client);
    journal_until(&mut journal, COMMAND_UNDO);
    browser.press("u");
    says(&browser, "no edit to undo");
}
