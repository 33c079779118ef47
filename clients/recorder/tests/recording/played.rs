//! A recording is played from any of its steps on.

use cosplat_recorder::chunks::Chunks;
use cosplat_recorder::tape::Tape;
use cosplat_recorder::writer::{Compression, WriterOptions};

use super::synthetic::Run;

const RUN: Run = Run {
    steps: 40,
    gaussians: 60,
    epoch: 5,
};

#[test]
fn a_tape_gives_back_any_step_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    for (compression, chunk_bytes) in [(Compression::None, 9_000), (Compression::Zstd, 4 << 20)] {
        let path = folder.path().join(format!("{compression:?}.mcap"));
        let options = WriterOptions {
            compression,
            chunk_bytes,
            ..Default::default()
        };
        RUN.write(&path, &options);
        let mut tape = Tape::open(Chunks::open(&path).unwrap(), 5, |_, _| {}).unwrap();
        assert_eq!((tape.count(), tape.range()), (40, Some([0, 39])));
        // From the start to the end, then anywhere.
        let all = (0..40).map(|step| (false, step));
        let jumps = [17, 3, 39, 0, 20].map(|step| (true, step));
        for (jumps, step) in all.chain(jumps) {
            if jumps {
                assert_eq!(tape.seek(step), Some(step));
            }
            assert_eq!(tape.next_step(), Some(step));
            let played = tape.advance().unwrap().unwrap();
            assert_eq!(played.frame.header, RUN.header(step));
            assert!(
                bytemuck::cast_slice::<_, u8>(&played.frame.gaussians)
                    == bytemuck::cast_slice::<_, u8>(&RUN.frame(step)),
                "Gaussians of step {step} differ"
            );
            assert_eq!(played.objects, Some(RUN.objects(step)));
            let command: Vec<_> = RUN.command(step).into_iter().collect();
            assert_eq!(played.journal, command, "step {step}");
        }
        assert_eq!(tape.seek(40), None);
        assert_eq!(
            tape.next_step(),
            Some(21),
            "a seek that fails moves nothing"
        );
        tape.seek(39);
        assert!(tape.advance().unwrap().is_some());
        assert!(tape.advance().unwrap().is_none(), "the end");
    }
}

#[test]
fn a_flipped_byte_is_found_in_its_chunk() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    RUN.write(
        &path,
        &WriterOptions {
            chunk_bytes: 9_000,
            ..Default::default()
        },
    );
    assert!(
        Chunks::open(&path)
            .unwrap()
            .first_damaged()
            .unwrap()
            .is_none()
    );
    let mut bytes = std::fs::read(&path).unwrap();
    let frame = RUN.frame(25);
    let pattern = bytemuck::bytes_of(&frame[7]);
    let at = bytes
        .windows(64)
        .position(|window| window == pattern)
        .unwrap();
    for place in [at + 3, at - 700] {
        bytes[place] ^= 1;
        std::fs::write(&path, &bytes).unwrap();
        let content = Chunks::open(&path).unwrap().first_damaged().unwrap();
        let content = content.expect("a damaged chunk");
        let words = content.damage.expect("why").to_string();
        assert!(words.contains("damaged"), "{words}");
        assert!(Tape::open(Chunks::open(&path).unwrap(), 5, |_, _| {}).is_err());
        bytes[place] ^= 1;
    }
}
