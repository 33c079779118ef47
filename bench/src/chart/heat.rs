//! Maps of what happens over two settings: one field per pair, coloured and lettered by what it was.

use super::{
    draw::{Align, Canvas, LARGE, LINE, MEDIUM, Pixel, SMALL, picture, width, wrapped},
    theme,
};

/// A picture of panels in rows, with one legend.
pub struct HeatMap {
    /// What is shown.
    pub title: String,
    /// Name and unit of the horizontal axis.
    pub x: String,
    /// Name and unit of the vertical axis.
    pub y: String,
    /// What a field can be.
    pub classes: Vec<Class>,
    /// Row by row.
    pub panels: Vec<HeatPanel>,
    /// Panels in a row, at least 1.
    pub columns: usize,
    /// Meaning of the line over the fields; empty without one.
    pub line: String,
    /// Lines below: what was measured how, machine, commit, flags.
    pub caption: Vec<String>,
}

/// What a field can be.
pub struct Class {
    /// For the legend.
    pub name: String,
    /// Written into the fields, for those who cannot tell the colours; may be empty.
    pub letter: String,
    /// 0 good, 1 doubtful, 2 bad, 3 none of them.
    pub tone: usize,
}

/// One map.
pub struct HeatPanel {
    /// What it is of.
    pub title: String,
    /// Values of the columns, ascending.
    pub x: Vec<f64>,
    /// Names of the rows, from the lowest.
    pub y: Vec<String>,
    /// Index of the class of each field, rows from the lowest; none where nothing was measured.
    pub fields: Vec<Vec<Option<usize>>>,
    /// Where the line crosses each row, in values of the columns; absent without a line.
    pub line: Option<Vec<f64>>,
}

/// Size of a field [pixels].
const FIELD: Pixel = (34, 22);
/// Room of a panel for its title, row names and column values: left, top, right, bottom [pixels].
const ROOM: [i32; 4] = [62, 26, 14, 24];

impl HeatMap {
    /// The picture.
    ///
    /// # Errors
    /// When drawing fails.
    pub fn svg(&self) -> anyhow::Result<String> {
        let fields = |of: fn(&HeatPanel) -> usize| {
            let most = self.panels.iter().map(of).max().unwrap_or(1);
            most.max(1) as i32
        };
        let panel = (
            ROOM[0] + FIELD.0 * fields(|p| p.x.len()) + ROOM[2],
            ROOM[1] + FIELD.1 * fields(|p| p.y.len()) + ROOM[3],
        );
        let columns = self.columns.clamp(1, self.panels.len().max(1)) as i32;
        let rows = (self.panels.len() as i32 + columns - 1) / columns;
        let legend: Vec<(&str, Option<&Class>)> = self
            .classes
            .iter()
            .map(|c| (c.name.as_str(), Some(c)))
            .chain((!self.line.is_empty()).then_some((self.line.as_str(), None)))
            .collect();
        let legend_width: i32 = legend.iter().map(|e| 52 + width(e.0, SMALL)).sum();
        let size_x = (34 + columns * panel.0).max(legend_width + 32).max(620);
        let caption: Vec<String> = self
            .caption
            .iter()
            .flat_map(|text| wrapped(text, size_x - 32, SMALL))
            .collect();
        let end = 40 + rows * panel.1;
        let size = (size_x, end + 62 + LINE * caption.len() as i32);
        picture(size, |canvas| {
            canvas.text(&self.title, (16, 22), LARGE, theme::INK, Align::Left)?;
            canvas.text_upwards(&self.y, (18, 40 + rows * panel.1 / 2), MEDIUM)?;
            for (n, map) in (0..).zip(&self.panels) {
                let origin = (34 + n % columns * panel.0, 40 + n / columns * panel.1);
                map.draw(canvas, origin, &self.classes)?;
            }
            let middle = 34 + columns * panel.0 / 2;
            canvas.text(
                &self.x,
                (middle, end + 8),
                MEDIUM,
                theme::INK,
                Align::Center,
            )?;
            let (mut x, y) = (20, end + 34);
            for (name, class) in legend {
                match class {
                    Some(class) => field(canvas, (x, y - 9), (26, 18), class)?,
                    None => canvas.line(&[(x, y), (x + 26, y)], theme::INK, 3)?,
                }
                canvas.text(name, (x + 32, y), SMALL, theme::INK, Align::Left)?;
                x += 52 + width(name, SMALL);
            }
            for (n, line) in (0..).zip(&caption) {
                let at = (16, y + 24 + LINE * n);
                canvas.text(line, at, SMALL, theme::FAINT, Align::Left)?;
            }
            Ok(())
        })
    }
}

fn field(canvas: &Canvas<'_>, at: Pixel, size: Pixel, class: &Class) -> anyhow::Result<()> {
    let tone = theme::FIELDS[class.tone.min(theme::FIELDS.len() - 1)];
    canvas.fill(at, (at.0 + size.0, at.1 + size.1), tone)?;
    let middle = (at.0 + size.0 / 2, at.1 + size.1 / 2);
    canvas.text(&class.letter, middle, SMALL, theme::INK, Align::Center)
}

impl HeatPanel {
    fn draw(&self, canvas: &Canvas<'_>, origin: Pixel, classes: &[Class]) -> anyhow::Result<()> {
        let (x0, y0) = (origin.0 + ROOM[0], origin.1 + ROOM[1]);
        let rows = self.y.len() as i32;
        let bottom = y0 + FIELD.1 * rows;
        let title = (x0, origin.1 + 14);
        canvas.text(&self.title, title, MEDIUM, theme::INK, Align::Left)?;
        for (n, value) in (0..).zip(&self.x) {
            let at = (x0 + FIELD.0 * n + FIELD.0 / 2, bottom + 11);
            canvas.text(&format!("{value}"), at, SMALL, theme::FAINT, Align::Center)?;
        }
        for (n, name) in (0..).zip(&self.y) {
            let top = bottom - FIELD.1 * (n + 1);
            let at = (x0 - 6, top + FIELD.1 / 2);
            canvas.text(name, at, SMALL, theme::FAINT, Align::Right)?;
            let Some(row) = self.fields.get(n as usize) else {
                continue;
            };
            for (m, class) in (0..).zip(row) {
                if let Some(class) = class.and_then(|c| classes.get(c)) {
                    let at = (x0 + FIELD.0 * m + 1, top + 1);
                    field(canvas, at, (FIELD.0 - 2, FIELD.1 - 2), class)?;
                }
            }
        }
        let Some(line) = &self.line else {
            return Ok(());
        };
        let mut path = Vec::new();
        for (n, value) in (0..).zip(line) {
            let x = x0 + (f64::from(FIELD.0) * self.column(*value)).round() as i32;
            path.push((x, bottom - FIELD.1 * n));
            path.push((x, bottom - FIELD.1 * (n + 1)));
        }
        canvas.line(&path, theme::INK, 3)
    }

    /// Where a value lies among the columns: n + 1/2 in the middle of the n-th.
    fn column(&self, value: f64) -> f64 {
        let after = self.x.iter().position(|x| *x >= value);
        let column = match after {
            None => self.x.len() as f64 - 0.5 + 0.4,
            Some(0) => 0.5 - if self.x[0] > value { 0.4 } else { 0.0 },
            Some(n) => {
                let (a, b) = (self.x[n - 1], self.x[n]);
                n as f64 - 0.5 + (value - a) / (b - a)
            }
        };
        column.clamp(0.0, self.x.len() as f64)
    }
}
