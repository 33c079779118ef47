//! Colours of charts on light and on dark pages.
//!
//! Charts are drawn in the light colours. A style element turns every one of them into its dark partner where the
//! page asks for a dark scheme. Both schemes have a panel of their own behind the drawing: a page that is dark by a
//! switch of its own, which a picture cannot see, still shows dark ink on a light panel.

use std::fmt::Write as _;

use plotters::style::RGBColor;

const fn rgb(hex: u32) -> RGBColor {
    RGBColor((hex >> 16) as u8, (hex >> 8) as u8, hex as u8)
}

/// Background.
pub const PANEL: RGBColor = rgb(0xFFFFFF);
/// Text, axes, marks.
pub const INK: RGBColor = rgb(0x1F2329);
/// Captions, ticks.
pub const FAINT: RGBColor = rgb(0x5A626D);
/// Lines of the grid.
pub const GRID: RGBColor = rgb(0xDFE3E8);
/// The Pareto front.
pub const FRONT: RGBColor = rgb(0x9AA3AE);

/// Colours of series, told apart in print and by colour-blind people too, because markers differ as well.
pub const SERIES: [RGBColor; 8] = [
    rgb(0x0B62C4),
    rgb(0xC2410C),
    rgb(0x0F7B5A),
    rgb(0x8B3FA8),
    rgb(0x8A6A00),
    rgb(0xC2185B),
    rgb(0x0E7490),
    rgb(0x4D5562),
];

/// Fields of heat maps: good, doubtful, bad, and none of them.
pub const FIELDS: [RGBColor; 4] = [rgb(0xBFE3CF), rgb(0xF6DD9B), rgb(0xEFA59A), rgb(0xE6E9ED)];

/// Light and dark partners.
const PARTNERS: [(RGBColor, u32); 17] = [
    (PANEL, 0x14181E),
    (INK, 0xE6EAF0),
    (FAINT, 0x9EA8B5),
    (GRID, 0x2B323C),
    (FRONT, 0x6B7684),
    (SERIES[0], 0x6FB1FF),
    (SERIES[1], 0xFF9B66),
    (SERIES[2], 0x55D3A6),
    (SERIES[3], 0xD9A0F2),
    (SERIES[4], 0xE5C558),
    (SERIES[5], 0xFF8FB8),
    (SERIES[6], 0x62D0E8),
    (SERIES[7], 0xB4BDC9),
    (FIELDS[0], 0x1F5C42),
    (FIELDS[1], 0x6E5513),
    (FIELDS[2], 0x7C2F28),
    (FIELDS[3], 0x333B46),
];

/// The drawing with the style element in it.
pub fn styled(svg: &str) -> String {
    let mut style = String::from("<style>\n@media (prefers-color-scheme: dark) {\n");
    for (RGBColor(r, g, b), dark) in PARTNERS {
        let light = format!("#{r:02X}{g:02X}{b:02X}");
        let _ = writeln!(
            style,
            "[fill=\"{light}\"]{{fill:#{dark:06X}}}[stroke=\"{light}\"]{{stroke:#{dark:06X}}}"
        );
    }
    style.push_str("}\n</style>\n");
    let after_root = svg.find('>').map_or(0, |end| end + 1);
    format!("{}\n{style}{}", &svg[..after_root], &svg[after_root..])
}
