//! Attacks by files: outputs that are their input, recordings that unpack to gigabytes, and what is no file at all.

use std::{fs, process::Command};

use anyhow::Context;
use rand_core::Rng;

use super::{act::Act, damage, troupe::is_orderly};

/// Address space of a command that reads a bomb [KiB]: program and threads fit, and not what the bomb claims.
const SPACE: u32 = 1_500_000;
/// What the bomb unpacks to [byte].
const BOMB: u64 = 3 << 30;
/// Largest block of packed data [byte].
const BLOCK: u64 = 128 << 10;

impl Act<'_> {
    /// A command that is to write onto what it reads must refuse, and leave it as it was.
    pub fn link_output(&mut self, rng: &mut impl Rng) -> anyhow::Result<()> {
        // A recorder that has just been started has no file yet.
        self.attached()?;
        let [input, output] = ["linked.mcap", "link.mcap"].map(|name| self.stage.path(name));
        fs::copy(&self.recording, &input).context("a copy of the recording")?;
        let _ = fs::remove_file(&output);
        match rng.next_u32() % 2 {
            0 => fs::hard_link(&input, &output)?,
            _ => std::os::unix::fs::symlink("linked.mcap", &output)?,
        }
        let before = fs::read(&input)?;
        let command = ["recover", "compact"][rng.next_u32() as usize % 2];
        let words = [command, "linked.mcap", "-o", "link.mcap", "--force"];
        let (status, words) = self.stage.ask(self.stage.command(&words)?)?;
        if status.code() != Some(1) || fs::read(&input)? != before {
            self.misbehaved(format!("{command} onto its input: {status}: {words}"));
        }
        Ok(())
    }

    /// A recording of 100 kB that unpacks to 3 GiB is refused in little memory.
    pub fn bomb(&mut self, rng: &mut impl Rng) -> anyhow::Result<()> {
        let path = self.stage.path("bomb.mcap");
        fs::write(&path, bomb())?;
        let what = ["inspect", "verify", "recover", "compact"][rng.next_u32() as usize % 4];
        let mut command = Command::new("sh");
        command
            .args([
                "-c",
                &format!("ulimit -v {SPACE} && exec \"$0\" {what} bomb.mcap"),
            ])
            .arg(std::env::current_exe()?);
        self.stage.prepare(&mut command);
        let (status, words) = self.stage.ask(command)?;
        // Recovery drops the chunk; all others refuse the file.
        let expected = i32::from(what != "recover");
        if status.code() != Some(expected) {
            self.misbehaved(format!("{what} of a bomb: {status}: {words}"));
        }
        let repaired = self.stage.path("bomb.recovered.mcap");
        if repaired.exists()
            && let Some(words) = damage::damaged(&repaired)
        {
            self.unreadable(format!("what is left of a bomb: {words}"));
        }
        let _ = fs::remove_file(repaired);
        Ok(())
    }

    /// A device or a pipe in the place of a recording is refused at once.
    pub fn device(&mut self, rng: &mut impl Rng) -> anyhow::Result<()> {
        let pipe = self.stage.path("pipe");
        if !pipe.exists() {
            let made = Command::new("mkfifo").arg(&pipe).status()?;
            anyhow::ensure!(made.success(), "mkfifo: {made}");
        }
        let pipe = pipe.to_string_lossy().into_owned();
        let input = ["/dev/zero", "/dev/full", &*pipe][rng.next_u32() as usize % 3];
        let what = ["inspect", "verify", "recover", "compact"][rng.next_u32() as usize % 4];
        let words = match what {
            "recover" | "compact" => vec![what, input, "-o", "of-device.mcap", "--force"],
            _ => vec![what, input],
        };
        let (status, words) = self.stage.ask(self.stage.command(&words)?)?;
        let is_left = self.stage.path("of-device.mcap").exists();
        if !is_orderly(status) || status.success() || is_left {
            self.misbehaved(format!("{what} {input}: {status}: {words}"));
        }
        Ok(())
    }
}

/// A recording of one chunk of zeros.
fn bomb() -> Vec<u8> {
    let record = |opcode: u8, body: &[u8]| {
        let length = (body.len() as u64).to_le_bytes();
        [&[opcode][..], &length, body].concat()
    };
    // A frame of zstd: magic, no length, a window of 8 MiB, and blocks that repeat one byte.
    let mut packed = vec![0x28, 0xb5, 0x2f, 0xfd, 0, 13 << 3];
    for block in 1..=BOMB / BLOCK {
        let is_last = u64::from(block == BOMB / BLOCK);
        let header = BLOCK << 3 | 1 << 1 | is_last;
        packed.extend_from_slice(&header.to_le_bytes()[..3]);
        packed.push(0);
    }
    let mut chunk = vec![0; 16];
    chunk.extend(BOMB.to_le_bytes());
    chunk.extend(0_u32.to_le_bytes());
    chunk.extend(4_u32.to_le_bytes());
    chunk.extend(b"zstd");
    chunk.extend((packed.len() as u64).to_le_bytes());
    chunk.extend(packed);
    let magic = b"\x89MCAP0\r\n";
    let records = [
        record(1, &[0; 8]),
        record(6, &chunk),
        record(15, &[0; 4]),
        record(2, &[0; 20]),
    ];
    [&magic[..], &records.concat(), magic].concat()
}
