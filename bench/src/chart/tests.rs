//! What a chart must show, and what the front of a set of points is.

use super::*;

#[test]
fn the_front_holds_what_nothing_beats() {
    let points = [
        [1.0, 5.0],
        [2.0, 3.0],
        [2.5, 4.0],
        [f64::NAN, 0.1],
        [3.0, 1.0],
        [3.0, 2.0],
        [9.0, f64::INFINITY],
    ];
    assert_eq!(pareto(&points), [0, 1, 4]);
    // At its error of 4, the third point costs 2.5 where 2 would do.
    assert!((cost_over_front(&points, 2) - 1.25).abs() < 1e-12);
    assert!((cost_over_front(&points, 4) - 1.0).abs() < 1e-12);
}

#[test]
fn fields_with_commas_and_quotes_survive_csv() {
    let rows = [vec!["a,b".to_owned(), "say \"x\"".to_owned()]];
    let text = csv(&["first", "second"], &rows);
    assert_eq!(text, "first,second\n\"a,b\",\"say \"\"x\"\"\"\n");
}

fn figure() -> Figure {
    let point = |x: f64, y: f64, emphasis| Point {
        x,
        x_range: Some([0.9 * x, 1.2 * x]),
        y,
        label: format!("dx / {x}"),
        emphasis,
    };
    let series = |name: &str, shift: f64| Series {
        name: name.into(),
        points: vec![
            point(0.02 * shift, 0.3, Emphasis::None),
            point(0.1 * shift, 0.05 * shift, Emphasis::Default),
            point(1.1 * shift, 0.004, Emphasis::Named),
            point(f64::NAN, 0.1, Emphasis::None),
        ],
        line: true,
    };
    let panel = |x: &str| Panel {
        x: x.into(),
        y: "relative error".into(),
        series: (0..7)
            .map(|n| series(&format!("setting {n}"), 1.0 + 0.3 * f64::from(n)))
            .collect(),
        front: true,
    };
    Figure {
        title: "Bar: error against cost".into(),
        panels: vec![panel("wall seconds per simulated second"), panel("updates")],
        caption: vec!["One thread, a caption long enough to be broken into lines. ".repeat(6)],
    }
}

fn map() -> HeatMap {
    let class = |name: &str, letter: &str, tone| Class {
        name: name.into(),
        letter: letter.into(),
        tone,
    };
    HeatMap {
        title: "Stability".into(),
        x: "dt / dt_crit".into(),
        y: "Poisson's ratio".into(),
        classes: vec![
            class("pass", "", 0),
            class("damped", "d", 1),
            class("blown up", "x", 2),
        ],
        panels: (0..4)
            .map(|n| HeatPanel {
                title: format!("panel {n}"),
                x: vec![0.5, 0.9, 1.0, 1.1, 1.5],
                y: ["0", "0.3", "0.45"].map(String::from).to_vec(),
                fields: vec![vec![Some(0), Some(0), Some(1), Some(2), None]; 3],
                line: Some(vec![1.0, 1.05, 1.2]),
            })
            .collect(),
        columns: 2,
        line: "closed-form limit".into(),
        caption: vec!["dev profile".into()],
    }
}

/// Written where someone can look at them: `CHARTS=DIR cargo test -p cosplat chart`.
fn look(name: &str, svg: &str) {
    if let Some(folder) = std::env::var_os("CHARTS") {
        std::fs::write(std::path::Path::new(&folder).join(name), svg).expect("folder exists");
    }
}

#[test]
fn a_chart_shows_marks_and_says_what_it_leaves_out() {
    let svg = figure().svg().expect("draws");
    look("loglog.svg", &svg);
    for text in [
        "Bar: error against cost",
        "default setting",
        "Pareto front",
        "setting 3",
    ] {
        assert!(svg.contains(text), "{text} is missing");
    }
    assert!(
        svg.contains("no result: setting 0 dx / NaN"),
        "hidden points are named"
    );
}

/// The style element turns colours that the drawing uses, spelled as in the drawing.
#[test]
fn every_colour_of_a_chart_has_a_dark_partner() {
    for (name, svg) in [("loglog.svg", figure().svg()), ("heat.svg", map().svg())] {
        let svg = svg.expect("draws");
        look(name, &svg);
        let drawing = svg.split("</style>").nth(1).expect("has a style");
        for attribute in ["fill=\"#", "stroke=\"#"] {
            for at in drawing.match_indices(attribute) {
                let value = &drawing[at.0..at.0 + attribute.len() + 7];
                assert!(
                    svg.contains(&format!("[{value}]{{")),
                    "{value} stays in the dark"
                );
            }
        }
    }
}

#[test]
fn a_chart_without_points_is_still_a_picture() {
    let mut empty = figure();
    for panel in &mut empty.panels {
        panel.series.clear();
    }
    assert!(empty.svg().expect("draws").ends_with("</svg>\n"));
}
