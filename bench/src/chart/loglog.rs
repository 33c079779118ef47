//! Work against precision: points with quartile bars on logarithmic axes, the Pareto front under them.

use super::{
    draw::{Align, Canvas, LARGE, LINE, MEDIUM, Pixel, SMALL, picture, width},
    pareto, theme,
};

/// A picture of one or more panels side by side, with one legend.
pub struct Figure {
    /// What is shown.
    pub title: String,
    /// From left to right.
    pub panels: Vec<Panel>,
    /// Lines below: what was measured how, machine, commit, flags, threads.
    pub caption: Vec<String>,
}

/// One pair of axes.
pub struct Panel {
    /// Name and unit of the horizontal axis.
    pub x: String,
    /// Name and unit of the vertical axis.
    pub y: String,
    /// Curves; those of the same place in other panels have the same colour and name.
    pub series: Vec<Series>,
    /// Whether smaller is better on both axes, so that there is a Pareto front to draw.
    pub front: bool,
}

/// Points that belong together.
pub struct Series {
    /// For the legend.
    pub name: String,
    /// In the order in which the line visits them.
    pub points: Vec<Point>,
    /// Whether a line joins them.
    pub line: bool,
}

/// One measured point. Coordinates that are not finite and positive cannot be shown and are counted in the caption.
#[derive(Clone)]
pub struct Point {
    /// Horizontal coordinate.
    pub x: f64,
    /// Its quartiles, where it was measured several times.
    pub x_range: Option<[f64; 2]>,
    /// Vertical coordinate.
    pub y: f64,
    /// Short text beside it; may be empty.
    pub label: String,
    /// How it stands out.
    pub emphasis: Emphasis,
}

/// How a point stands out.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Emphasis {
    /// Not at all.
    None,
    /// A ring and a bold label: one of several named choices.
    Named,
    /// Two rings: what users get who choose nothing.
    Default,
}

/// Size of one panel with its axes [pixels].
const PANEL: Pixel = (600, 430);
/// Room in it for axes: left, top, right, bottom.
const ROOM: [i32; 4] = [78, 30, 22, 52];

impl Point {
    fn shown(&self) -> bool {
        [self.x, self.y].iter().all(|c| c.is_finite() && *c > 0.0)
    }
}

impl Figure {
    /// The picture.
    ///
    /// # Errors
    /// When drawing fails.
    pub fn svg(&self) -> anyhow::Result<String> {
        let size_x = PANEL.0 * self.panels.len().max(1) as i32 + 16;
        let legend = self.legend_rows(size_x);
        let caption = self.caption_lines(size_x);
        let below = (legend.len() + caption.len()) as i32 * LINE + 26;
        let size = (size_x, 36 + PANEL.1 + below);
        picture(size, |canvas| {
            let at = (16, 22);
            canvas.text(&self.title, at, LARGE, theme::INK, Align::Left)?;
            for (n, panel) in (0..).zip(&self.panels) {
                panel.draw(canvas, (n * PANEL.0, 36))?;
            }
            let mut y = 36 + PANEL.1 + LINE / 2;
            for row in &legend {
                for (x, entry) in row {
                    entry.draw(canvas, (*x, y))?;
                }
                y += LINE;
            }
            y += 8;
            for line in &caption {
                canvas.text(line, (16, y), SMALL, theme::FAINT, Align::Left)?;
                y += LINE;
            }
            Ok(())
        })
    }

    fn legend_rows(&self, size_x: i32) -> Vec<Vec<(i32, Entry<'_>)>> {
        let mut entries: Vec<Entry<'_>> = Vec::new();
        if let Some(panel) = self.panels.first() {
            let series = panel.series.iter().enumerate();
            entries.extend(series.map(|(n, s)| Entry::Series(n, &s.name)));
        }
        if self.panels.iter().any(|p| p.front) {
            entries.push(Entry::Front);
        }
        let points = |e: Emphasis| {
            let mut all = self.panels.iter().flat_map(|p| &p.series);
            all.any(|s| s.points.iter().any(|p| p.emphasis == e))
        };
        if points(Emphasis::Default) {
            entries.push(Entry::Default);
        }
        let mut rows = vec![Vec::new()];
        let mut x = 24;
        for entry in entries {
            let needed = 26 + width(entry.name(), SMALL) + 14;
            if x + needed > size_x && x > 24 {
                rows.push(Vec::new());
                x = 24;
            }
            if let Some(row) = rows.last_mut() {
                row.push((x, entry));
            }
            x += needed;
        }
        rows
    }

    /// The caption, broken into lines that fit.
    fn caption_lines(&self, size_x: i32) -> Vec<String> {
        let mut lines = Vec::new();
        let points = self.panels.iter().flat_map(|p| &p.series);
        let mut hidden: Vec<String> = Vec::new();
        for (series, point) in points.flat_map(|s| s.points.iter().map(move |p| (s, p))) {
            let name = format!("{} {}", series.name, point.label).trim().to_owned();
            // Panels show the same points.
            if !point.shown() && !hidden.contains(&name) {
                hidden.push(name);
            }
        }
        let mut texts = self.caption.clone();
        if !hidden.is_empty() {
            texts.push(format!(
                "Not on the chart, no error or no result: {}.",
                hidden.join(", ")
            ));
        }
        for text in texts {
            lines.extend(super::draw::wrapped(&text, size_x - 32, SMALL));
        }
        lines
    }
}

/// One entry of the legend.
enum Entry<'f> {
    Series(usize, &'f str),
    Front,
    Default,
}

impl Entry<'_> {
    fn name(&self) -> &str {
        match self {
            Self::Series(_, name) => name,
            Self::Front => "Pareto front",
            Self::Default => "default setting",
        }
    }

    fn draw(&self, canvas: &Canvas<'_>, (x, y): Pixel) -> anyhow::Result<()> {
        match self {
            Self::Series(n, _) => canvas.marker((x + 8, y), *n)?,
            Self::Front => canvas.dashed(&[(x, y), (x + 18, y)], theme::FRONT, 4.0)?,
            Self::Default => double_ring(canvas, (x + 8, y))?,
        }
        let at = (x + 24, y);
        canvas.text(self.name(), at, SMALL, theme::INK, Align::Left)
    }
}

fn double_ring(canvas: &Canvas<'_>, at: Pixel) -> anyhow::Result<()> {
    canvas.circle(at, 6, theme::INK, Some(1))?;
    canvas.circle(at, 9, theme::INK, Some(2))
}

/// One logarithmic axis.
struct LogAxis {
    /// Decimal logarithms of both ends.
    ends: [f64; 2],
    /// Pixels of both ends.
    pixels: [i32; 2],
}

impl LogAxis {
    fn new(values: impl Iterator<Item = f64>, pixels: [i32; 2]) -> Self {
        let logs = values.filter(|v| v.is_finite() && *v > 0.0).map(f64::log10);
        let (low, high) = logs.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| {
            (a.min(v), b.max(v))
        });
        let [low, high] = if low <= high {
            [low, high]
        } else {
            [-1.0, 0.0]
        };
        // At least half a decade, so that noise is not blown up to look like a trend.
        let margin = (0.07 * (high - low))
            .max((0.5 - (high - low)) / 2.0)
            .max(0.06);
        Self {
            ends: [low - margin, high + margin],
            pixels,
        }
    }

    fn pixel(&self, value: f64) -> i32 {
        let t = (value.log10() - self.ends[0]) / (self.ends[1] - self.ends[0]);
        let [a, b] = self.pixels.map(f64::from);
        (a + t.clamp(0.0, 1.0) * (b - a)).round() as i32
    }

    /// Values with a line, and whether they have a label.
    fn ticks(&self) -> Vec<(f64, bool)> {
        let decades = self.ends[1] - self.ends[0];
        let labelled: &[u32] = match decades {
            d if d > 2.2 => &[1],
            d if d > 1.2 => &[1, 3],
            _ => &[1, 2, 5],
        };
        let every = (decades / 7.0).ceil().max(1.0) as i32;
        let first = self.ends[0].floor() as i32;
        let last = self.ends[1].ceil() as i32;
        let mut ticks = Vec::new();
        for exponent in first..=last {
            for digit in 1..10 {
                let value = f64::from(digit) * 10f64.powi(exponent);
                if (self.ends[0]..=self.ends[1]).contains(&value.log10()) {
                    let label = labelled.contains(&digit) && exponent.rem_euclid(every) == 0;
                    ticks.push((value, label));
                }
            }
        }
        ticks.retain(|t| t.1 || decades < 4.0);
        ticks
    }
}

/// A short decimal for a tick.
fn tick_text(value: f64) -> String {
    if (0.0009..9999.5).contains(&value) {
        let digits = (-value.log10().floor()).max(0.0) as usize;
        format!("{value:.digits$}")
    } else {
        format!("{value:.0e}")
    }
}

impl Panel {
    fn points(&self) -> impl Iterator<Item = &Point> {
        self.series
            .iter()
            .flat_map(|s| &s.points)
            .filter(|p| p.shown())
    }

    fn draw(&self, canvas: &Canvas<'_>, origin: Pixel) -> anyhow::Result<()> {
        let [left, top, right, bottom] = ROOM;
        let (x0, x1) = (origin.0 + left, origin.0 + PANEL.0 - right);
        let (y0, y1) = (origin.1 + PANEL.1 - bottom, origin.1 + top);
        let wide = self
            .points()
            .flat_map(|p| [p.x].into_iter().chain(p.x_range.into_iter().flatten()));
        let x = LogAxis::new(wide, [x0, x1]);
        let y = LogAxis::new(self.points().map(|p| p.y), [y0, y1]);
        for (value, label) in x.ticks() {
            let at = x.pixel(value);
            canvas.line(&[(at, y0), (at, y1)], theme::GRID, 1)?;
            if label {
                let place = (at, y0 + 13);
                canvas.text(&tick_text(value), place, SMALL, theme::FAINT, Align::Center)?;
            }
        }
        for (value, label) in y.ticks() {
            let at = y.pixel(value);
            canvas.line(&[(x0, at), (x1, at)], theme::GRID, 1)?;
            if label {
                let place = (x0 - 7, at);
                canvas.text(&tick_text(value), place, SMALL, theme::FAINT, Align::Right)?;
            }
        }
        canvas.line(&[(x0, y1), (x0, y0), (x1, y0)], theme::INK, 1)?;
        let below = ((x0 + x1) / 2, y0 + 34);
        canvas.text(&self.x, below, MEDIUM, theme::INK, Align::Center)?;
        canvas.text_upwards(&self.y, (origin.0 + 20, (y0 + y1) / 2), MEDIUM)?;
        if self.front {
            self.draw_front(canvas, &x, &y)?;
        }
        self.draw_series(canvas, &x, &y)
    }

    /// Steps to the right and down through the points that no other beats.
    fn draw_front(&self, canvas: &Canvas<'_>, x: &LogAxis, y: &LogAxis) -> anyhow::Result<()> {
        let points: Vec<[f64; 2]> = self.points().map(|p| [p.x, p.y]).collect();
        let corners: Vec<Pixel> = pareto(&points)
            .into_iter()
            .map(|i| (x.pixel(points[i][0]), y.pixel(points[i][1])))
            .collect();
        let (Some(first), Some(last)) = (corners.first(), corners.last()) else {
            return Ok(());
        };
        let mut path = vec![(first.0, y.pixels[1])];
        for corner in &corners {
            if let Some(&(_, before)) = path.last()
                && path.len() > 1
            {
                path.push((corner.0, before));
            }
            path.push(*corner);
        }
        path.push((x.pixels[1], last.1));
        canvas.dashed(&path, theme::FRONT, 5.0)
    }

    fn draw_series(&self, canvas: &Canvas<'_>, x: &LogAxis, y: &LogAxis) -> anyhow::Result<()> {
        let pixel = |p: &Point| (x.pixel(p.x), y.pixel(p.y));
        for (n, series) in self.series.iter().enumerate() {
            let color = theme::SERIES[n % theme::SERIES.len()];
            let shown: Vec<&Point> = series.points.iter().filter(|p| p.shown()).collect();
            if series.line && shown.len() > 1 {
                let path: Vec<Pixel> = shown.iter().map(|p| pixel(p)).collect();
                canvas.line(&path, color, 1)?;
            }
            for point in &shown {
                let at = pixel(point);
                if let Some([low, high]) = point.x_range {
                    let (a, b) = (x.pixel(low), x.pixel(high));
                    canvas.line(&[(a, at.1), (b, at.1)], color, 1)?;
                    for end in [a, b] {
                        canvas.line(&[(end, at.1 - 3), (end, at.1 + 3)], color, 1)?;
                    }
                }
                canvas.marker(at, n)?;
            }
        }
        let mut taken: Vec<[i32; 4]> = self.points().map(|p| around(pixel(p), 5)).collect();
        // Named choices first: their labels matter most.
        for named in [true, false] {
            for (n, series) in self.series.iter().enumerate() {
                for point in series.points.iter().filter(|p| p.shown()) {
                    let at = pixel(point);
                    if (point.emphasis != Emphasis::None) != named {
                        continue;
                    }
                    let color = if named {
                        theme::INK
                    } else {
                        theme::SERIES[n % theme::SERIES.len()]
                    };
                    match point.emphasis {
                        Emphasis::None => {}
                        Emphasis::Named => canvas.circle(at, 8, theme::INK, Some(1))?,
                        Emphasis::Default => double_ring(canvas, at)?,
                    }
                    let frame = [x.pixels[0], y.pixels[1], x.pixels[1], y.pixels[0]];
                    if let Some(place) = free_place(&point.label, at, frame, &mut taken) {
                        canvas.text(&point.label, place, SMALL, color, Align::Left)?;
                    }
                }
            }
        }
        Ok(())
    }
}

fn around((x, y): Pixel, reach: i32) -> [i32; 4] {
    [x - reach, y - reach, x + reach, y + reach]
}

/// Where the left end of a label can stand near its point without covering points and other labels; none when
/// there is no room.
fn free_place(
    text: &str,
    (x, y): Pixel,
    frame: [i32; 4],
    taken: &mut Vec<[i32; 4]>,
) -> Option<Pixel> {
    if text.is_empty() {
        return None;
    }
    let w = width(text, SMALL);
    let places = [
        (x + 11, y - 10),
        (x + 11, y + 10),
        (x - 11 - w, y - 10),
        (x - 11 - w, y + 10),
        (x - w / 2, y - 18),
        (x - w / 2, y + 18),
        (x + 14, y),
        (x - 14 - w, y),
    ];
    let fits = |&(left, middle): &Pixel| {
        let b = [left, middle - 7, left + w, middle + 7];
        let inside = b[0] >= frame[0] && b[2] <= frame[2] && b[1] >= frame[1] && b[3] <= frame[3];
        let apart = |t: &[i32; 4]| b[2] < t[0] || t[2] < b[0] || b[3] < t[1] || t[3] < b[1];
        inside && taken.iter().all(apart)
    };
    let place = places.into_iter().find(fits)?;
    taken.push([place.0, place.1 - 7, place.0 + w, place.1 + 7]);
    Some(place)
}
