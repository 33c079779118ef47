//! Strokes that both kinds of charts share.

use anyhow::anyhow;
use plotters::{
    backend::SVGBackend,
    coord::Shift,
    drawing::{DrawingArea, IntoDrawingArea},
    element::{Circle, PathElement, Polygon, Rectangle, Text},
    style::{
        Color, IntoTextStyle, RGBColor, ShapeStyle,
        text_anchor::{HPos, Pos, VPos},
    },
};

use super::theme;

/// A point of the picture [pixels, down and right].
pub type Pixel = (i32, i32);

/// A picture being drawn.
pub struct Canvas<'s> {
    area: DrawingArea<SVGBackend<'s>, Shift>,
}

/// Height of a line of small text [pixels].
pub const LINE: i32 = 17;
/// Sizes of text; the backend writes four fifths of them [pixels].
pub const SMALL: u32 = 15;
/// For titles of panels and names of axes.
pub const MEDIUM: u32 = 17;
/// For the title of the picture.
pub const LARGE: u32 = 21;

/// Draws a picture of that size and makes it a styled SVG.
///
/// # Errors
/// When drawing fails.
pub fn picture(
    size: Pixel,
    draw: impl FnOnce(&Canvas<'_>) -> anyhow::Result<()>,
) -> anyhow::Result<String> {
    let mut svg = String::new();
    {
        let backend = SVGBackend::with_string(&mut svg, (size.0 as u32, size.1 as u32));
        let canvas = Canvas {
            area: backend.into_drawing_area(),
        };
        canvas.fill((0, 0), size, theme::PANEL)?;
        draw(&canvas)?;
        canvas.area.present().map_err(failed)?;
    }
    Ok(theme::styled(&svg))
}

fn failed(error: impl std::fmt::Display) -> anyhow::Error {
    anyhow!("cannot draw: {error}")
}

/// Width that a text takes, roughly: no font is at hand, and the page chooses it [pixels].
pub fn width(text: &str, size: u32) -> i32 {
    (text.chars().count() as f64 * f64::from(size) * 0.49).ceil() as i32
}

/// Where a text stands against its point.
#[derive(Clone, Copy)]
pub enum Align {
    /// Its left end is there.
    Left,
    /// Its middle.
    Center,
    /// Its right end.
    Right,
}

impl Canvas<'_> {
    /// A line through points.
    pub fn line(&self, points: &[Pixel], color: RGBColor, width: u32) -> anyhow::Result<()> {
        let style = ShapeStyle::from(&color).stroke_width(width);
        let path = PathElement::new(points.to_vec(), style);
        self.area.draw(&path).map_err(failed)
    }

    /// A dashed line; `dash` and gap have that length.
    pub fn dashed(&self, points: &[Pixel], color: RGBColor, dash: f64) -> anyhow::Result<()> {
        for two in points.windows(2) {
            let [a, b] = [two[0], two[1]].map(|p| [f64::from(p.0), f64::from(p.1)]);
            let length = (b[0] - a[0]).hypot(b[1] - a[1]);
            let at = |s: f64| {
                let t = (s / length).min(1.0);
                let c = |n: usize| (a[n] + t * (b[n] - a[n])).round() as i32;
                (c(0), c(1))
            };
            let pieces = (length / (2.0 * dash)).ceil() as i32;
            for piece in 0..pieces {
                let start = 2.0 * dash * f64::from(piece);
                self.line(&[at(start), at(start + dash)], color, 2)?;
            }
        }
        Ok(())
    }

    /// A filled rectangle.
    pub fn fill(&self, from: Pixel, to: Pixel, color: RGBColor) -> anyhow::Result<()> {
        let style = ShapeStyle::from(&color).filled();
        self.area
            .draw(&Rectangle::new([from, to], style))
            .map_err(failed)
    }

    /// A text with its vertical middle at the point.
    pub fn text(
        &self,
        text: &str,
        at: Pixel,
        size: u32,
        color: RGBColor,
        align: Align,
    ) -> anyhow::Result<()> {
        let h = match align {
            Align::Left => HPos::Left,
            Align::Center => HPos::Center,
            Align::Right => HPos::Right,
        };
        let style = ("sans-serif", size)
            .into_text_style(&self.area)
            .color(&color)
            .pos(Pos::new(h, VPos::Center));
        self.area
            .draw(&Text::new(text.to_owned(), at, style))
            .map_err(failed)
    }

    /// A text that runs upwards, centred at the point.
    pub fn text_upwards(&self, text: &str, at: Pixel, size: u32) -> anyhow::Result<()> {
        let style = ("sans-serif", size)
            .into_text_style(&self.area)
            .color(&theme::INK)
            .transform(plotters::style::FontTransform::Rotate270)
            .pos(Pos::new(HPos::Center, VPos::Center));
        self.area
            .draw(&Text::new(text.to_owned(), at, style))
            .map_err(failed)
    }

    /// A circle, or a ring of that width.
    pub fn circle(
        &self,
        at: Pixel,
        radius: i32,
        color: RGBColor,
        ring: Option<u32>,
    ) -> anyhow::Result<()> {
        let style = match ring {
            None => color.filled(),
            Some(width) => ShapeStyle::from(&color).stroke_width(width),
        };
        self.area
            .draw(&Circle::new(at, radius, style))
            .map_err(failed)
    }

    /// The marker of the n-th series: shapes differ, so that colours need not be told apart.
    pub fn marker(&self, at: Pixel, series: usize) -> anyhow::Result<()> {
        let color = theme::SERIES[series % theme::SERIES.len()];
        let (x, y) = at;
        let polygon = |points: &[Pixel]| {
            let moved: Vec<Pixel> = points.iter().map(|p| (x + p.0, y + p.1)).collect();
            self.area
                .draw(&Polygon::new(moved, color.filled()))
                .map_err(failed)
        };
        match series % 6 {
            0 => self.circle(at, 4, color, None),
            1 => polygon(&[(-5, 4), (5, 4), (0, -5)]),
            2 => self.fill((x - 4, y - 4), (x + 4, y + 4), color),
            3 => polygon(&[(-5, 0), (0, 5), (5, 0), (0, -5)]),
            4 => polygon(&[(-5, -4), (5, -4), (0, 5)]),
            _ => {
                self.line(&[(x - 4, y - 4), (x + 4, y + 4)], color, 3)?;
                self.line(&[(x - 4, y + 4), (x + 4, y - 4)], color, 3)
            }
        }
    }
}

/// A text as lines that are at most so wide [pixels].
pub fn wrapped(text: &str, most: i32, size: u32) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split(' ') {
        let Some(line) = lines.last_mut() else {
            continue;
        };
        if !line.is_empty() && width(line, size) + width(word, size) + 4 > most {
            lines.push(word.to_owned());
        } else {
            if !line.is_empty() {
                line.push(' ');
            }
            line.push_str(word);
        }
    }
    lines
}
