//! The walk over a recording: where a run of a server begins, and which events belong to it.

use cosplat_recorder::{
    reader::Event,
    runs::{Lack, RunHeader},
    topics::RUN_METADATA,
};

/// How a run begins in the file.
#[derive(Clone, Debug, PartialEq)]
pub struct Beginning {
    /// Identifies the run; 0 where nothing says it.
    pub epoch: u64,
    /// Its metadata, or in a sentence why there are none.
    pub header: Result<RunHeader, String>,
}

/// Goes through the events of a recording in the order of the file.
#[derive(Clone, Copy, Debug, Default)]
pub struct Walk {
    epoch: Option<u64>,
}

impl Walk {
    /// Identifies the run that the last event belongs to.
    pub fn epoch(&self) -> Option<u64> {
        self.epoch
    }

    /// The run that begins with the next `event`, if one does: with its metadata, or without them where the file has gone
    /// on to another epoch.
    pub fn next(&mut self, event: &Event) -> Option<Beginning> {
        let named = match event {
            Event::Metadata { name, values } if name == RUN_METADATA => {
                let header = RunHeader::parse(values);
                let epoch = header.as_ref().map_or(0, |header| header.scene.epoch);
                self.epoch = Some(epoch);
                return Some(Beginning { epoch, header });
            }
            // A gap says what is missing of the run around it.
            Event::Metadata { .. } | Event::Attachment { .. } | Event::Gap(_) => return None,
            Event::Frame(frame) => Some(frame.header.epoch),
            Event::Objects(header, _) => Some(header.epoch),
            Event::Journal(entry) => entry.epoch,
        };
        let epoch = named.or(self.epoch).unwrap_or_default();
        (self.epoch.replace(epoch) != Some(epoch)).then(|| Beginning {
            epoch,
            header: Err(Lack::Metadata { epoch }.to_string()),
        })
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use cosplat_ipc::schema::ObjectsHeader;
    use cosplat_recorder::messages::JournalEntry;

    use super::*;

    fn objects(epoch: u64) -> Event {
        let header = ObjectsHeader {
            epoch,
            ..Default::default()
        };
        Event::Objects(header, Vec::new())
    }

    #[test]
    fn a_run_begins_with_metadata_or_another_epoch() {
        let mut walk = Walk::default();
        let metadata = Event::Metadata {
            name: RUN_METADATA.into(),
            values: BTreeMap::new(),
        };
        let begun = walk.next(&metadata).expect("a run");
        assert!(
            begun
                .header
                .is_err_and(|why| why.contains("session") || why.contains("epoch"))
        );
        let begun = walk.next(&objects(7)).expect("another epoch");
        let lack = Lack::Metadata { epoch: 7 };
        assert_eq!((begun.epoch, begun.header), (7, Err(lack.to_string())));
        let unnamed = Event::Journal(JournalEntry {
            applied: Default::default(),
            epoch: None,
            index: None,
        });
        for event in [unnamed, objects(7)] {
            assert_eq!(walk.next(&event), None);
        }
        assert!(walk.next(&objects(8)).is_some());
        assert_eq!(walk.epoch(), Some(8));
    }
}
