//! Processor time that nobody else wants, and what is done where there is none.
//!
//! Threads of the idle class run where a processor would stand still, and give way at once. Those of the lowest priority get
//! a little time on any machine, at the cost of who is in a hurry. So pictures are drawn by the former, and by the latter
//! where idle threads do not get through.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, TryRecvError, sync_channel};
use std::time::{Duration, Instant};

use rayon::{ThreadPool, ThreadPoolBuilder};
use thread_priority::{
    NormalThreadSchedulePolicy, ThreadPriority, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};

use crate::Image;

/// Priority given up: all of it.
const NICENESS: i32 = 19;
/// How long idle threads may take, at least and at most.
const PATIENCE: [Duration; 2] = [Duration::from_millis(250), Duration::from_secs(2)];
/// How many times as long as a picture is known to take.
const SLOWER: u32 = 4;

/// Gives this thread the lowest priority that always gets some time; threads that it starts have it as well.
pub(crate) fn give_way() {
    if let Err(error) = rustix::process::nice(NICENESS) {
        tracing::debug!(%error, "keeps its priority");
    }
}

fn become_idle() {
    let policy = ThreadSchedulePolicy::Normal(NormalThreadSchedulePolicy::Idle);
    let made = set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Min, policy);
    if let Err(error) = made {
        tracing::debug!(?error, "has no idle class");
        give_way();
    }
}

/// Draws in idle time.
pub(crate) struct IdleTime {
    pool: Option<ThreadPool>,
    /// A picture that idle threads were too slow for: while they work on it there is no idle time.
    unfinished: Option<Receiver<Image>>,
    patience: Duration,
}

impl IdleTime {
    /// Starts a thread for every processor, from a thread that has not given way.
    pub fn new() -> Self {
        let pool = ThreadPoolBuilder::new()
            .thread_name(|n| format!("idle-{n}"))
            .start_handler(|_| become_idle())
            .build();
        Self {
            pool: pool
                .inspect_err(|error| tracing::debug!(%error, "draws without idle threads"))
                .ok(),
            unfinished: None,
            patience: PATIENCE[0],
        }
    }

    /// Makes a picture in idle time, or on this thread's own where there is too little of that.
    pub fn make(&mut self, draw: impl Fn() -> Image + Send + Sync + 'static) -> Image {
        let draw = Arc::new(draw);
        let is_at_work = |image: &Receiver<Image>| image.try_recv() == Err(TryRecvError::Empty);
        let is_busy = self.unfinished.as_ref().is_some_and(is_at_work);
        if let (Some(pool), false) = (&self.pool, is_busy) {
            let (tell, image) = sync_channel(1);
            let idle = Arc::clone(&draw);
            pool.spawn(move || {
                let image = idle();
                // Whoever waits may have what it was drawn of for himself.
                drop(idle);
                // Nobody waits for it any more where that fails.
                let _ = tell.send(image);
            });
            match image.recv_timeout(self.patience) {
                Ok(image) => return image,
                Err(RecvTimeoutError::Timeout) => self.unfinished = Some(image),
                // It panicked, and will do so again here.
                Err(RecvTimeoutError::Disconnected) => {}
            }
        }
        let start = Instant::now();
        let image = draw();
        self.patience = (SLOWER * start.elapsed()).clamp(PATIENCE[0], PATIENCE[1]);
        image
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;

    use super::*;

    fn plain(value: u8) -> Image {
        Image {
            width: 1,
            height: 1,
            rgb: vec![value; 3],
        }
    }

    #[test]
    fn pictures_are_made_though_idle_threads_get_no_time() {
        let mut time = IdleTime::new();
        assert_eq!(time.make(|| plain(1)), plain(1));
        // One that an idle thread never ends, as on a machine that is never idle.
        let (let_go, held) = channel::<()>();
        let held = std::sync::Mutex::new(held);
        let image = time.make(move || {
            let name = std::thread::current().name().map(str::to_owned);
            if name.is_some_and(|name| name.starts_with("idle-")) {
                let _ = held.lock().map(|held| held.recv());
            }
            plain(2)
        });
        assert_eq!(image, plain(2));
        // Meanwhile none is given to them.
        let image = time.make(|| {
            let name = std::thread::current().name().map(str::to_owned);
            plain(u8::from(name.is_some_and(|name| name.starts_with("idle-"))))
        });
        assert_eq!(image, plain(0));
        drop(let_go);
    }
}
