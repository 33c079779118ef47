//! A recording passes through the page cache and does not stay there.
//!
//! A recorder of large scenes writes some hundred megabytes per second. Left alone, they fill the memory of the machine,
//! push out what others use, and every page of them is a fresh one, which costs the kernel, and in a virtual machine its
//! host, more than the copy into it.

use std::fs::File;
use std::io::Seek;

use rustix::fs::{Advice, fadvise};

/// Bytes after which the system is asked to write, and to forget.
const WINDOW: u64 = 16 << 20;
/// Windows that are asked for again: by then what was being written is on the disk and can be forgotten.
const AGAIN: u64 = 8;

/// Keeps an eye on the end of a file.
#[derive(Debug)]
pub(crate) struct WriteBehind {
    /// Shares its position with the file that is written.
    file: File,
    /// End of what was asked for.
    asked: u64,
}

impl WriteBehind {
    /// Of a file that is written from its start.
    pub(crate) fn of(file: &File) -> std::io::Result<Self> {
        Ok(Self {
            file: file.try_clone()?,
            asked: 0,
        })
    }

    /// To be called when everything up to the end is final: a page that is forgotten and written again is read first.
    ///
    /// Starts writing what is new, and forgets what has been written; waits for neither. It is advice: where a file
    /// system knows nothing of it, nothing happens.
    pub(crate) fn advance(&mut self) {
        let Ok(end) = self.file.stream_position() else {
            return;
        };
        if end < self.asked + WINDOW {
            return;
        }
        let from = self.asked.saturating_sub(AGAIN * WINDOW);
        let length = std::num::NonZeroU64::new(end - from);
        let _ = fadvise(&self.file, from, length, Advice::DontNeed);
        self.asked = end;
    }
}

#[cfg(test)]
mod tests {
    use std::io::{Read, SeekFrom, Write};

    use super::*;

    #[test]
    fn a_file_holds_what_was_written_whatever_was_forgotten() {
        let mut file = tempfile::tempfile().expect("a file");
        let mut behind = WriteBehind::of(&file).expect("a second handle");
        let piece: Vec<u8> = (0..=WINDOW / 2).map(|n| (n % 251) as u8).collect();
        let pieces = 2 * (AGAIN as usize + 2);
        let mut asked = 0;
        for _ in 0..pieces {
            file.write_all(&piece).expect("written");
            behind.advance();
            asked += u64::from(behind.asked == file.stream_position().expect("a position"));
        }
        assert!(asked > AGAIN, "asked {asked} times");
        file.seek(SeekFrom::Start(0)).expect("the start");
        let mut read = vec![0; piece.len()];
        for n in 0..pieces {
            file.read_exact(&mut read).expect("as long as it was");
            assert!(read == piece, "piece {n} differs");
        }
        assert_eq!(file.read(&mut read).expect("the end"), 0);
    }
}
