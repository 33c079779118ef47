//! The files of the pages, as they are served: path, type, text.

const JS: &str = "text/javascript";

/// A file: path, type, text.
pub type File = (&'static str, &'static str, &'static str);

/// What both pages have.
const COMMON: &[File] = &[
    ("/style.css", "text/css", include_str!("page/style.css")),
    ("/link.js", JS, include_str!("page/link.js")),
    ("/state.js", JS, include_str!("page/state.js")),
    ("/draw.js", JS, include_str!("page/draw.js")),
    ("/shaders.js", JS, include_str!("page/shaders.js")),
    ("/camera.js", JS, include_str!("page/camera.js")),
    ("/pick.js", JS, include_str!("page/pick.js")),
];

/// The page of a session.
const SESSION: &[File] = &[
    ("/", "text/html", include_str!("page/index.html")),
    ("/main.js", JS, include_str!("page/main.js")),
    ("/panel.js", JS, include_str!("page/panel.js")),
    ("/edit.js", JS, include_str!("page/edit.js")),
    ("/pointer.js", JS, include_str!("page/pointer.js")),
    ("/charts.js", JS, include_str!("page/charts.js")),
];

/// The page on which a splat is parted by strokes.
const STROKES: &[File] = &[
    ("/", "text/html", include_str!("page/strokes.html")),
    ("/strokes.js", JS, include_str!("page/strokes.js")),
];

/// The file at a path of the page of a session, or of the page of strokes.
pub fn find(path: &str, has_strokes: bool) -> Option<&'static File> {
    let own = if has_strokes { STROKES } else { SESSION };
    own.iter().chain(COMMON).find(|(name, ..)| *name == path)
}
