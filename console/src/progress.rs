//! Progress bars on standard error, silent when that is not a terminal.

use std::cell::RefCell;

use indicatif::{ProgressBar, ProgressFinish, ProgressStyle};

use crate::output::plain;

/// A bar over `length` units with a free message at its end.
pub fn bar(label: &str, length: u64) -> ProgressBar {
    let bar = ProgressBar::new(length);
    let style =
        ProgressStyle::with_template("{prefix} [{bar:30}] {pos}/{len} {msg} {elapsed_precise}")
            .unwrap_or_else(|_| ProgressStyle::default_bar());
    bar.set_style(style);
    bar.set_prefix(label.to_owned());
    bar
}

/// A counter for work of unknown length.
pub fn spinner(label: &str) -> ProgressBar {
    let bar = ProgressBar::new_spinner();
    let style = ProgressStyle::with_template("{prefix} {pos} {msg} {elapsed_precise}")
        .unwrap_or_else(|_| ProgressStyle::default_spinner());
    bar.set_style(style);
    bar.set_prefix(label.to_owned());
    bar
}

/// Bars of a work of several parts, which are named one after the other; the bar of a part goes when the next begins. What is
/// returned takes the part, what of it is done, of how much (0 where nobody knows), and a message.
pub fn parts() -> impl Fn(&'static str, u64, u64, &str) {
    let shown = RefCell::new(None::<(&str, ProgressBar)>);
    move |part, done, of, message| {
        let mut shown = shown.borrow_mut();
        if shown.as_ref().is_none_or(|(former, _)| *former != part) {
            *shown = None;
            let made = match of {
                0 => spinner(part),
                _ => bar(part, of),
            };
            *shown = Some((part, made.with_finish(ProgressFinish::AndClear)));
        }
        if let Some((_, bar)) = &*shown {
            bar.set_position(done);
            bar.set_message(plain(message).into_owned());
        }
    }
}
