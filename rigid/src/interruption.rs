//! The wish of somebody outside that a frame ends before it is done.

use std::{
    fmt,
    sync::atomic::{AtomicBool, Ordering},
};

/// Asked between substeps whether to go on, and no more once the answer was no. What asks must be cheap: it is asked as often as once
/// per microsecond, from whichever thread is at work.
pub struct Interruption<'a> {
    asks: &'a (dyn Fn() -> bool + Sync),
    seen: AtomicBool,
}

impl fmt::Debug for Interruption<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Interruption").field(&self.seen).finish()
    }
}

static NEVER: Interruption<'static> = Interruption {
    asks: &|| false,
    seen: AtomicBool::new(false),
};

impl<'a> Interruption<'a> {
    /// One that comes when `asks` says so.
    pub fn when(asks: &'a (dyn Fn() -> bool + Sync)) -> Self {
        Self {
            asks,
            seen: AtomicBool::new(false),
        }
    }

    /// Whether what is at work has to end.
    pub fn is_due(&self) -> bool {
        if !self.was_due() && (self.asks)() {
            self.seen.store(true, Ordering::Relaxed);
        }
        self.was_due()
    }

    /// Whether it was due before.
    pub fn was_due(&self) -> bool {
        self.seen.load(Ordering::Relaxed)
    }
}

impl Interruption<'static> {
    /// One that never comes.
    pub fn never() -> &'static Self {
        &NEVER
    }
}
