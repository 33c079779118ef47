//! The page in a real browser, driven by ChromeDriver: what it draws, and what keys alone do.

use std::io::Write;
use std::net::TcpStream;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use cosplat_ipc::client::Client;
use cosplat_ipc::schema::{GaussianState, SERVER_PAUSED, SERVER_RUNNING, SceneHeader};
use cosplat_renderer::{
    Image,
    camera::{Camera, Orbit, up_from_gravity},
    drawing::BACKGROUND,
    picture,
};
use cosplat_web::packing::{Bounds, pack, unpack};
use serde_json::{Value, json};

use crate::stage::{
    PATIENCE, Process, Stage, command, next_frame, psnr, test_data, wait_for_status, watchdog,
};
use crate::web::{Page, read_answer};

/// Keys that WebDriver gives numbers to.
const LEFT: &str = "\u{e012}";

/// How long a page may take for a picture: it draws without a graphics processor, and shares the others with all stories.
const DRAWING: Duration = Duration::from_secs(2 * PATIENCE.as_secs());

/// A browser without a window; dropped, it is closed.
pub struct Browser {
    _driver: Process,
    port: String,
    session: String,
}

/// The program, or a word about the skip, which is a failure where all is required.
fn program(name: &str) -> Option<PathBuf> {
    let folders = std::env::var_os("PATH").unwrap_or_default();
    let found = std::env::split_paths(&folders)
        .map(|folder| folder.join(name))
        .find(|path| path.is_file());
    if found.is_none() {
        let required = std::env::var_os("COSPLAT_REQUIRE_ALL").is_some();
        assert!(!required, "{name} is not installed");
        eprintln!("SKIPPED: {name} is not installed");
    }
    found
}

impl Browser {
    pub fn open(link: &str) -> Option<Browser> {
        let (driver, chromium) = (program("chromedriver")?, program("chromium")?);
        let mut command = command(driver);
        command.arg("--port=0");
        let mut driver = Process::start(command);
        let mut seen = driver.wait_for_output("started successfully on port");
        seen += &driver.wait_for_output("\n");
        let port: String = seen
            .rsplit("on port")
            .next()
            .map(|rest| rest.chars().filter(char::is_ascii_digit).collect())
            .expect("a port");
        let mut browser = Browser {
            _driver: driver,
            port,
            session: String::new(),
        };
        let arguments = [
            "--headless=new",
            "--no-sandbox",
            "--no-first-run",
            "--disable-quic",
            "--disable-background-networking",
            "--use-angle=swiftshader",
            "--enable-unsafe-swiftshader",
            "--window-size=500,500",
        ];
        let wanted = json!({ "capabilities": { "alwaysMatch": {
            "goog:chromeOptions": { "args": arguments, "binary": chromium },
            "goog:loggingPrefs": { "browser": "ALL" },
        } } });
        let session = browser.ask("/session", &wanted);
        let id = session["sessionId"].as_str().expect("a session");
        browser.session = format!("/session/{id}");
        browser.post("/url", &json!({ "url": link }));
        Some(browser)
    }

    fn ask(&self, path: &str, body: &Value) -> Value {
        let mut stream = TcpStream::connect(format!("127.0.0.1:{}", self.port)).expect("a driver");
        stream.set_read_timeout(Some(DRAWING)).expect("a time-out");
        let body = body.to_string();
        let length = body.len();
        let head = format!("POST {path} HTTP/1.1\r\nhost: localhost\r\ncontent-length: {length}");
        write!(stream, "{head}\r\n\r\n{body}").expect("the driver listens");
        let answer = read_answer(&mut stream);
        let text = String::from_utf8_lossy(&answer.2);
        assert_eq!(answer.0, 200, "{path}: {text}");
        let mut answer: Value = serde_json::from_str(&text).expect("the driver speaks JSON");
        answer["value"].take()
    }

    pub fn post(&self, path: &str, body: &Value) -> Value {
        self.ask(&format!("{}{path}", self.session), body)
    }

    /// What a script on the page returns.
    pub fn script(&self, text: &str) -> Value {
        self.post("/execute/sync", &json!({ "script": text, "args": [] }))
    }

    /// Waits until a script returns true.
    pub fn wait_for(&self, text: &str) {
        let deadline = Instant::now() + DRAWING;
        while self.script(text) != json!(true) {
            let message = self.script("return document.getElementById('message').textContent");
            assert!(Instant::now() < deadline, "{text}: {message}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    pub fn press(&self, key: &str) {
        let [down, up] = ["keyDown", "keyUp"].map(|kind| json!({ "type": kind, "value": key }));
        let keys = json!({ "actions": [{ "type": "key", "id": "keys", "actions": [down, up] }] });
        self.post("/actions", &keys);
    }

    /// Presses a key without letting it go, `keyDown`, or lets it go, `keyUp`.
    pub fn key(&self, key: &str, kind: &str) {
        let action = json!({ "type": kind, "value": key });
        let keys = json!({ "actions": [{ "type": "key", "id": "keys", "actions": [action] }] });
        self.post("/actions", &keys);
    }

    /// Moves the mouse to a place of the page [pixel], and presses and releases its left button.
    pub fn pointer(&self, moves: &[(&str, i64, i64)]) {
        let actions: Vec<Value> = moves
            .iter()
            .map(|(what, x, y)| match *what {
                "move" => json!({ "type": "pointerMove", "duration": 100, "x": x, "y": y }),
                "down" => json!({ "type": "pointerDown", "button": 0 }),
                _ => json!({ "type": "pointerUp", "button": 0 }),
            })
            .collect();
        let mouse =
            json!({ "actions": [{ "type": "pointer", "id": "mouse", "actions": actions }] });
        self.post("/actions", &mouse);
    }

    /// The picture on the canvas.
    fn picture(&self) -> Image {
        let size =
            self.script("const c = document.getElementById('view'); return [c.width, c.height]");
        let [width, height] = [0, 1].map(|n| size[n].as_u64().expect("pixels") as u32);
        let rgb = self.script(
            "const c = document.getElementById('view'), f = document.createElement('canvas');
             [f.width, f.height] = [c.width, c.height];
             const pen = f.getContext('2d');
             pen.drawImage(c, 0, 0);
             return [...pen.getImageData(0, 0, f.width, f.height).data].filter((_, n) => n % 4 < 3)",
        );
        let levels = rgb.as_array().expect("levels").iter();
        Image {
            width,
            height,
            rgb: levels.map(|l| l.as_u64().expect("a level") as u8).collect(),
        }
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        // Without its browser's end, the driver would leave that behind when it is killed.
        if let Ok(mut stream) = TcpStream::connect(format!("127.0.0.1:{}", self.port)) {
            let _ = stream.set_read_timeout(Some(DRAWING));
            let path = &self.session;
            let _ = write!(stream, "DELETE {path} HTTP/1.1\r\nhost: localhost\r\n\r\n");
            let _ = std::io::Read::read(&mut stream, &mut [0]);
        }
    }
}

/// The page in a browser, where its session has a first picture and is then paused, with the client and the step; none
/// without a browser.
pub fn paused_in_browser(page: &Page) -> Option<(Browser, Client, u64)> {
    let browser = Browser::open(&page.link())?;
    browser.wait_for("return cosplat.pictures > 1 && cosplat.state.figures !== null");
    let client = page.stage.client();
    browser.press(" ");
    let paused = wait_for_status(&client, |s| s.server_state == SERVER_PAUSED);
    browser.wait_for(&format!("return cosplat.state.step === {}", paused.step));
    Some((browser, client, paused.step))
}

/// The newest frame, which is of this step.
pub fn gaussians_of(client: &Client, step: u64) -> Vec<GaussianState> {
    let frame = next_frame(&mut client.frames(1).expect("frames"));
    assert_eq!(frame.header().step, step);
    frame.gaussians().to_vec()
}

/// The camera of a scene's picture.
fn camera(scene: &SceneHeader, orbit: Orbit, width: u32, height: u32) -> Camera {
    let bounds = [scene.bounds_min, scene.bounds_max].map(glam::Vec3::from_array);
    Camera::orbit(bounds, up_from_gravity(scene.gravity), orbit, width, height)
}

/// The camera that the page begins with.
pub fn first_camera(client: &Client, width: u32, height: u32) -> Camera {
    let orbit = Orbit {
        azimuth: 35f32.to_radians(),
        elevation: 20f32.to_radians(),
        ..Orbit::default()
    };
    let scene = client.scene(PATIENCE).expect("a scene");
    camera(scene.header(), orbit, width, height)
}

/// Asserts that the canvas shows this step as `view` draws it, from where the page begins.
fn assert_alike(browser: &Browser, client: &Client, step: u64) {
    let gaussians = gaussians_of(client, step);
    let theirs = browser.picture();
    let camera = first_camera(client, theirs.width, theirs.height);
    let ours = picture(&gaussians, None, &camera, BACKGROUND);
    let found = psnr(&ours, &theirs);
    // Another order of two Gaussians at one depth, half floats and 8 bits at the end: 54 dB and more where there is no
    // mistake.
    assert!(found >= 45.0, "{found:.1} dB");
    // One pixel aside it is another picture: by twice the squared error at least, however little of it objects fill.
    let [x, y] = camera.center;
    let aside = Camera {
        center: [x + 1.0, y],
        ..camera
    };
    let missed = psnr(&picture(&gaussians, None, &aside, BACKGROUND), &theirs);
    assert!(
        missed + 3.0 < found,
        "{found:.1} dB, {missed:.1} dB one pixel aside"
    );
}

/// Tens of thousands of Gaussians, of which the leaves are on their way.
#[test]
fn a_browser_draws_a_captured_plant_as_view_does() {
    let _watchdog = watchdog();
    let Some(splat) = test_data("plant.splat") else {
        return;
    };
    let stage = Stage::new();
    // Every fourth: without a graphics processor, all take minutes beside processes that never wait.
    let whole = std::fs::read(splat).expect("a readable splat");
    let every_fourth: Vec<_> = whole.chunks_exact(32).step_by(4).collect();
    std::fs::write(stage.path("plant.splat"), every_fourth.concat()).expect("a writable folder");
    let scene = include_str!("../../scenes/paper/plant_push.toml");
    let server = stage.serve_scene(scene, &["--paused"]);
    assert!(stage.ctl(&["step", "12"]).status.success());
    let client = stage.client();
    wait_for_status(&client, |s| s.step == 12);
    let page = Page::beside(stage, Some(server), &[]);
    let Some(browser) = Browser::open(&page.link()) else {
        return;
    };
    browser.wait_for("return cosplat.pictures > 0 && cosplat.state.step === 12");
    browser.wait_for("return cosplat.isCurrent");
    assert_alike(&browser, &client, 12);
}

#[test]
fn a_browser_draws_what_view_draws_and_obeys_keys() {
    let _watchdog = watchdog();
    let page = Page::open(&[]);
    let Some((browser, client, paused)) = paused_in_browser(&page) else {
        return;
    };
    browser.press(".");
    wait_for_status(&client, |s| s.step == paused + 1);
    browser.wait_for(&format!("return cosplat.state.step === {}", paused + 1));
    // A selected object is marked for a while.
    std::thread::sleep(Duration::from_millis(1500));
    browser.wait_for("return cosplat.isCurrent");
    assert_alike(&browser, &client, paused + 1);

    browser.press(LEFT);
    browser.wait_for("return cosplat.camera.azimuth < 0.55");
    let selected = browser.script("return cosplat.panel.selected");
    browser.press("n");
    assert_ne!(browser.script("return cosplat.panel.selected"), selected);
    let before = wait_for_status(&client, |_| true).commands_accepted;
    browser.press("]");
    wait_for_status(&client, |s| s.commands_accepted > before);
    browser.press("k");
    wait_for_status(&client, |s| s.commands_accepted > before + 1);
    browser.press(" ");
    wait_for_status(&client, |s| s.server_state == SERVER_RUNNING);
    let log = browser.post("/se/log", &json!({ "type": "browser" }));
    let errors: Vec<_> = log.as_array().expect("a log").iter().collect();
    let errors: Vec<_> = errors.iter().filter(|e| e["level"] == "SEVERE").collect();
    assert!(errors.is_empty(), "{errors:?}");
}

#[test]
fn graphics_that_a_browser_lost_come_back() {
    let _watchdog = watchdog();
    let page = Page::open(&[]);
    let Some((browser, client, paused)) = paused_in_browser(&page) else {
        return;
    };
    // As by a driver that begins anew, or a computer that slept.
    browser.script(
        "const gl = document.getElementById('view').getContext('webgl2');
         window.loss = gl.getExtension('WEBGL_lose_context');
         loss.loseContext();
         return 0",
    );
    let message = "return document.getElementById('message').textContent";
    browser.wait_for(&format!("{message}.includes('lost its graphics')"));
    // What comes meanwhile is not forgotten.
    assert!(page.stage.ctl(&["step"]).status.success());
    browser.wait_for(&format!("return cosplat.state.step === {}", paused + 1));
    browser.script("loss.restoreContext(); return 0");
    browser.wait_for(&format!("{message} === '' && cosplat.isCurrent"));
    // A selected object is marked for a while.
    std::thread::sleep(Duration::from_millis(1500));
    browser.wait_for("return cosplat.isCurrent");
    assert_alike(&browser, &client, paused + 1);
    browser.press(".");
    browser.wait_for(&format!("return cosplat.state.step === {}", paused + 2));
    browser.wait_for("return cosplat.isCurrent");
    assert_alike(&browser, &client, paused + 2);
}

#[test]
fn the_page_fits_a_desktop_and_a_phone() {
    let _watchdog = watchdog();
    let page = Page::open(&[]);
    let Some((browser, client, paused)) = paused_in_browser(&page) else {
        return;
    };
    // A selected object is marked for a while.
    std::thread::sleep(Duration::from_millis(1500));
    for (width, height, is_phone) in [(1280, 657, false), (390, 844, true)] {
        let size =
            json!({ "width": width, "height": height, "deviceScaleFactor": 1, "mobile": is_phone });
        let order = json!({ "cmd": "Emulation.setDeviceMetricsOverride", "params": size });
        browser.post("/goog/cdp/execute", &order);
        browser.wait_for(&format!(
            "const c = document.getElementById('view');
             return innerWidth === {width} && c.width === c.clientWidth && c.height === c.clientHeight && cosplat.isCurrent"
        ));
        let fits = browser.script(
            "const panel = document.getElementById('panel'), { hidden } = panel;
             panel.hidden = false;
             const fits = [panel, document.documentElement].map((e) => e.scrollWidth - e.clientWidth);
             panel.hidden = hidden;
             return fits",
        );
        assert_eq!(fits, json!([0, 0]), "{width} pixels: too wide by so many");
        assert_alike(&browser, &client, paused);
    }
}

#[test]
fn what_was_removed_is_not_drawn() {
    let _watchdog = watchdog();
    let page = Page::open(&[]);
    let Some((browser, client, paused)) = paused_in_browser(&page) else {
        return;
    };
    let name = browser.script("return cosplat.state.objects[0].name");
    let removed = page.stage.ctl(&["remove", name.as_str().expect("a name")]);
    assert!(removed.status.success(), "{removed:?}");
    browser.press(".");
    wait_for_status(&client, |s| s.step == paused + 1);
    browser.wait_for("return cosplat.state.objects[0].figures.fidelity === 7");
    browser.wait_for("return cosplat.isCurrent");
    let gaussians = gaussians_of(&client, paused + 1);
    let theirs = browser.picture();
    let camera = first_camera(&client, theirs.width, theirs.height);
    let ours = picture(&gaussians, None, &camera, BACKGROUND);
    // As where nothing was removed.
    let found = psnr(&ours, &theirs);
    assert!(found >= 45.0, "{found:.1} dB");
    let mut whole = gaussians;
    let hidden = whole.iter_mut().filter(|g| g.object == 0);
    assert!(hidden.map(|g| g.color[3] = 255).count() > 0);
    let found = psnr(&picture(&whole, None, &camera, BACKGROUND), &theirs);
    assert!(found < 45.0, "{found:.1} dB with what was removed");
}

#[test]
fn sixteen_bytes_cost_a_picture_less_than_60_decibels() {
    let _watchdog = watchdog();
    let text = include_str!("../../scenes/two_vases.toml");
    let stage = Stage::new();
    let _server = stage.serve_scene(text, &["--paused"]);
    let client = stage.client();
    let frame = next_frame(&mut client.frames(1).expect("frames"));
    let whole: Vec<GaussianState> = frame.gaussians().to_vec();
    let packed = whole.chunk_by(|a, b| a.object == b.object).flat_map(|own| {
        let bounds = Bounds::of(own);
        own.iter().filter_map(move |gaussian| {
            let (position, covariance) = unpack(pack(gaussian, &bounds), &bounds)?;
            Some(GaussianState {
                position,
                covariance,
                ..*gaussian
            })
        })
    });
    let packed: Vec<GaussianState> = packed.collect();
    let scene = client.scene(PATIENCE).expect("a scene");
    let camera = camera(scene.header(), Orbit::default(), 640, 480);
    let [a, b] = [&whole, &packed].map(|g| picture(g, None, &camera, BACKGROUND));
    // Positions are within a 130,000th of their box: with 75 dB measured there is room to the bar of 60.
    let found = psnr(&a, &b);
    assert!(found >= 60.0, "{found:.1} dB");
}
