//! Messages of a recording as events: whole frames again, of those that changed.

use std::borrow::Cow;
use std::collections::BTreeMap;

use cosplat_ipc::assembly::{Assembly, Placement};
use cosplat_ipc::schema::{GaussianState, ObjectState};
use foxglove::messages::FrameTransforms;
use mcap::records::{MessageHeader, Record};
use prost::Message;
use serde::de::DeserializeOwned;

use crate::messages::{JournalRecord, ObjectsRecord, StatusRecord};
use crate::packed::{ENCODING, Points};
use crate::point_cloud::{self, WORLD_FRAME};
use crate::reader::{BadMessage, Event, RecordedFrame, Traffic};
use crate::topics::*;

/// Gaussians of an object as a message tells them.
#[derive(Clone)]
struct Told {
    object: u32,
    /// Whether they are in the world frame, or in the object's own.
    is_in_world: bool,
    first: usize,
    gaussians: Vec<GaussianState>,
}

/// Turns records into events.
#[derive(Clone, Default)]
pub(crate) struct Decoder {
    /// Topics of channels, and whether their messages are packed.
    topics: BTreeMap<u16, (String, bool)>,
    points: Points,
    pub(crate) traffic: BTreeMap<String, Traffic>,
    pub(crate) skips_gaussians: bool,
    /// Newest `/status`, which precedes the Gaussians of its step.
    status: Option<StatusRecord>,
    frame: Assembly,
    /// Epoch and step that `frame` is of; `None` while it is being read.
    position: Option<(u64, u64)>,
    /// What was told so far of a whole frame.
    whole: Option<Vec<Told>>,
    /// Whether what the present frame builds on was read.
    is_founded: bool,
    /// States of all objects by id, and their epoch.
    objects: (u64, BTreeMap<u32, ObjectState>),
}

impl Decoder {
    pub(crate) fn decode(&mut self, record: Record) -> Result<Option<Event>, BadMessage> {
        match record {
            Record::Channel(channel) => {
                let is_packed = channel.message_encoding == ENCODING;
                self.topics.insert(channel.id, (channel.topic, is_packed));
                Ok(None)
            }
            Record::Metadata(record) => Ok(Some(Event::Metadata {
                name: record.name,
                values: record.metadata,
            })),
            Record::Attachment { header, data, .. } => Ok(Some(Event::Attachment {
                name: header.name,
                data: data.into_owned(),
            })),
            Record::Message { header, data } => {
                let (topic, is_packed) = self
                    .topics
                    .get(&header.channel_id)
                    .cloned()
                    .unwrap_or_default();
                let traffic = self.traffic.entry(topic.clone()).or_default();
                traffic.messages += 1;
                traffic.bytes += data.len() as u64;
                let message = match is_packed && !self.skips_gaussians {
                    true => self.points.unpack(header.channel_id, &data),
                    false => Ok(Cow::Borrowed(&data[..])),
                };
                message
                    .and_then(|message| self.message(&topic, &header, &message))
                    .map_err(|why| BadMessage::new(topic, header.sequence, why))
            }
            _ => Ok(None),
        }
    }

    fn message(
        &mut self,
        topic: &str,
        header: &MessageHeader,
        data: &[u8],
    ) -> Result<Option<Event>, String> {
        if let Some(object) = object_of(topic) {
            return self.object(object, header, data).map(|()| None);
        }
        Ok(Some(match topic {
            STATUS_TOPIC => {
                self.begin(json(data)?);
                return Ok(None);
            }
            GAUSSIANS_TOPIC => Event::Frame(Box::new(self.whole(header, data)?)),
            PLACES_TOPIC => {
                return Ok(self
                    .placed(header, data)?
                    .map(|frame| Event::Frame(Box::new(frame))));
            }
            OBJECTS_TOPIC => return Ok(self.objects(&json(data)?)),
            JOURNAL_TOPIC => Event::Journal((&json::<JournalRecord>(data)?).into()),
            GAPS_TOPIC => Event::Gap(json(data)?),
            _ => return Ok(None),
        }))
    }

    /// A frame begins. What builds on a frame that was not read is left out until a whole one comes.
    fn begin(&mut self, status: StatusRecord) {
        if let Some(since) = status.since {
            if since == status.step {
                self.whole = Some(Vec::new());
                self.is_founded = true;
            } else {
                self.whole = None;
                self.is_founded = self.position == Some((status.epoch.0, since));
            }
            self.position = None;
        }
        self.status = Some(status);
    }

    /// The status of the frame that a message belongs to.
    fn status_of(&self, header: &MessageHeader) -> Result<&StatusRecord, String> {
        let of_step = |s: &&StatusRecord| s.step as u32 == header.sequence;
        let status = self.status.as_ref().filter(of_step);
        status.ok_or_else(|| "the /status of the same step does not precede it".to_owned())
    }

    /// A frame in one message.
    fn whole(&mut self, header: &MessageHeader, data: &[u8]) -> Result<RecordedFrame, String> {
        let gaussians = match self.skips_gaussians {
            true => Vec::new(),
            false => point_cloud::decode(data)?.0,
        };
        let count = self.status_of(header)?.count;
        if !self.skips_gaussians && gaussians.len() != count as usize {
            return Err(format!(
                "{} Gaussians, but the /status of the same step says {count}",
                gaussians.len(),
            ));
        }
        self.finish(header, gaussians)
    }

    fn finish(
        &mut self,
        header: &MessageHeader,
        gaussians: Vec<GaussianState>,
    ) -> Result<RecordedFrame, String> {
        self.status_of(header)?;
        let status = self.status.take().ok_or("there is no /status")?;
        Ok(RecordedFrame {
            header: status.header(),
            gaussians,
            is_whole: status.since.is_none_or(|since| since == status.step),
            board: status.board,
            log_time: header.log_time,
        })
    }

    /// The Gaussians of an object, in the world frame or its own.
    fn object(&mut self, object: u32, header: &MessageHeader, data: &[u8]) -> Result<(), String> {
        self.status_of(header)?;
        if self.skips_gaussians || !self.is_founded {
            return Ok(());
        }
        let (gaussians, frame) = point_cloud::decode(data)?;
        let first = gaussians
            .first()
            .map_or(0, |gaussian| gaussian.index as usize);
        let told = Told {
            object,
            is_in_world: frame == WORLD_FRAME,
            first,
            gaussians,
        };
        match &mut self.whole {
            Some(whole) => {
                whole.push(told);
                Ok(())
            }
            None => put(&mut self.frame, &told),
        }
    }

    /// A whole frame of what was told of it. Memory is set aside for as many Gaussians as came, not as were announced.
    fn found(&mut self, count: u32) -> Result<(), String> {
        let Some(whole) = self.whole.take() else {
            return Ok(());
        };
        let told: usize = whole.iter().map(|told| told.gaussians.len()).sum();
        if told != count as usize {
            return Err(format!(
                "a whole frame tells {told} Gaussians, but the /status of the same step says {count}"
            ));
        }
        self.frame.begin(told);
        whole.iter().try_for_each(|told| put(&mut self.frame, told))
    }

    /// Places of bodies, which end a frame; `None` where it builds on one that was not read.
    fn placed(
        &mut self,
        header: &MessageHeader,
        data: &[u8],
    ) -> Result<Option<RecordedFrame>, String> {
        let status = self.status_of(header)?;
        let position = (status.epoch.0, status.step);
        if self.skips_gaussians {
            return self.finish(header, Vec::new()).map(Some);
        }
        if !self.is_founded {
            self.status = None;
            return Ok(None);
        }
        let count = status.count;
        self.found(count)?;
        let places = FrameTransforms::decode(data)
            .map_err(|e| format!("not a foxglove.FrameTransforms: {e}"))?;
        for place in places.transforms {
            let child = &place.child_frame_id;
            let object = child.strip_prefix("form/").and_then(|id| id.parse().ok());
            let object: u32 = object.ok_or_else(|| format!("{child:?} is no form"))?;
            let (t, q) = (
                place.translation.unwrap_or_default(),
                place.rotation.unwrap_or_default(),
            );
            let place = Placement {
                position: [t.x, t.y, t.z],
                rotation: [q.x, q.y, q.z, q.w],
            };
            if !self.frame.place(object, &place) {
                return Err(format!("{child:?} is placed, but was not told"));
            }
        }
        self.position = Some(position);
        let gaussians = self.frame.gaussians().to_vec();
        self.finish(header, gaussians).map(Some)
    }

    /// All objects, once all of them were told.
    fn objects(&mut self, record: &ObjectsRecord) -> Option<Event> {
        let header = record.header();
        let states = record.states();
        if record.count.is_none() {
            let by_id = states.iter().map(|state| (state.id, *state)).collect();
            self.objects = (header.epoch, by_id);
            return Some(Event::Objects(header, states));
        }
        if self.objects.0 != header.epoch || self.objects.1.len() != header.count as usize {
            return None;
        }
        let known = &mut self.objects.1;
        known.extend(states.into_iter().map(|state| (state.id, state)));
        Some(Event::Objects(header, known.values().copied().collect()))
    }
}

/// Puts what was told into a frame.
fn put(frame: &mut Assembly, told: &Told) -> Result<(), String> {
    let (first, gaussians) = (told.first, &told.gaussians);
    let fits = match told.is_in_world {
        true => frame.set(first, gaussians),
        false => frame.keep(told.object, first, gaussians),
    };
    fits.ok_or_else(|| {
        format!(
            "{} Gaussians from {first} on do not fit a frame of {}",
            gaussians.len(),
            frame.gaussians().len()
        )
    })
}

fn json<T: DeserializeOwned>(data: &[u8]) -> Result<T, String> {
    serde_json::from_slice(data).map_err(|e| e.to_string())
}
