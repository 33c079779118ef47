//! What goes out after a step, and to those who join between two.

use std::time::{Duration, Instant};

use cosplat_ipc::{
    schema::{self as wire, ChangesHeader, FrameHeader, GaussianState},
    server::{ChangesReaders, LoanRefused},
};
use cosplat_pacing::steering::Permission;
use cosplat_sim_core::StepReport;

use super::{ServeError, Server};
use crate::convert::contact_to_wire;

/// How often a lossless server that waits for memory looks for it, and at its clients and signals.
const LOSSLESS_WAIT: Duration = Duration::from_millis(1);
/// How long it still waits when it is told to stop.
const LAST_WAIT: Duration = Duration::from_secs(2);
/// How long a server in lock-step waits for memory, so that a participant finds the frame of its step, before it
/// skips the frame: a reader that stands still must not hold up the others for ever.
const LOCKSTEP_PATIENCE: Duration = Duration::from_secs(1);

impl Server<'_> {
    /// Sends the current state: objects, contacts, changes, frame, status.
    pub(super) fn publish(&mut self, flags: u32) -> Result<(), ServeError> {
        let count = self.summary.gaussians;
        let loan = self.patiently(|server| server.ports.loan_frame(count))?;
        // What came while it waited for memory counts as well.
        let flags = flags
            | match self.held_up() {
                Permission::Step => 0,
                Permission::Wait => wire::FRAME_FLAG_PAUSED,
                Permission::End => wire::FRAME_FLAG_LAST,
            };
        (self.flags, self.last_sent) = (flags, flags & wire::FRAME_FLAG_LAST != 0);
        self.publish_objects()?;
        let (world, gaussians) = (&self.world, &mut self.output.gaussians);
        self.pool.install(|| gaussians.prepare(world));
        let mut loan = loan;
        if let Some(loan) = &mut loan {
            let slot = loan.slot();
            self.pool
                .install(|| gaussians.update(world, slot, loan.gaussians_mut()));
        }
        let readers = self.ports.changes_readers();
        let frame = loan.as_mut().map(|loan| &*loan.gaussians_mut());
        let is_told = self.publish_changes(readers, frame)?;
        self.summary.frames_skipped += u64::from(loan.is_none() || !is_told);
        if let Some(loan) = loan {
            loan.send(&frame_header(self.world.report(), flags))?;
            self.summary.frames_published += 1;
        }
        let report = self.world.report();
        self.summary.sim_seconds = report.sim_time;
        self.summary.state_hash = report.state_hash;
        self.output.count(report);
        self.update_status()?;
        self.ports.maintain();
        Ok(())
    }

    fn publish_objects(&mut self) -> Result<(), ServeError> {
        let report = self.world.report();
        let objects = self.output.objects(&self.world);
        self.ports.publish_objects(
            &wire::ObjectsHeader {
                step: report.step,
                sim_time: report.sim_time,
                state_hash: report.state_hash,
                ..Default::default()
            },
            &objects,
        )?;
        let are_read = self.ports.contacts_are_read();
        self.contacts = match are_read || self.awaits_contact() {
            true => self.world.contacts().iter().map(contact_to_wire).collect(),
            false => vec![],
        };
        if are_read {
            let header = wire::ContactsHeader {
                step: report.step,
                sim_time: report.sim_time,
                ..Default::default()
            };
            self.ports.publish_contacts(&header, &self.contacts)?;
        }
        Ok(())
    }

    /// Sends what changed since the last message, and all of it to who is new; says whether readers know the step now.
    /// `frame` is the frame of the step, which is about to be sent.
    fn publish_changes(
        &mut self,
        readers: ChangesReaders,
        frame: Option<&[GaussianState]>,
    ) -> Result<bool, ServeError> {
        match readers {
            ChangesReaders::None => return Ok(true),
            ChangesReaders::New => self.told.forget(),
            ChangesReaders::Same => {}
        }
        let plan = self.told.plan(&self.world, &self.output.gaussians);
        let size = (plan.rows.len(), plan.gaussians);
        let loan = self.patiently(|server| server.ports.loan_changes(size.0, size.1))?;
        let Some(mut loan) = loan else {
            return Ok(false);
        };
        let (rows, gaussians) = loan.parts_mut();
        rows.copy_from_slice(&plan.rows);
        let (world, writer) = (&self.world, &self.output.gaussians);
        self.pool
            .install(|| plan.write(world, writer, frame, gaussians));
        let report = self.world.report();
        let header = ChangesHeader {
            step: report.step,
            sim_time: report.sim_time,
            dt: report.dt,
            state_hash: report.state_hash,
            since: plan.since,
            gaussians: self.summary.gaussians as u32,
            substeps: report.substeps,
            flags: self.flags,
            ..ChangesHeader::default()
        };
        self.ports.send_changes(loan, &header, frame.is_none())?;
        self.told.sent(&self.world);
        Ok(true)
    }

    /// Sends the present state to readers of `changes` that came since the last step.
    pub(super) fn greet_readers(&mut self) -> Result<(), ServeError> {
        let readers = self.ports.changes_readers();
        let is_due = match readers {
            ChangesReaders::None => false,
            ChangesReaders::New => true,
            ChangesReaders::Same => self.told.is_empty(),
        };
        if is_due {
            self.publish_changes(readers, None)?;
        }
        Ok(())
    }

    /// Memory for the next frame: at once, or as soon as readers give some back when nothing may be lost. Clients are
    /// answered meanwhile. `None` where it is in use by readers.
    fn patiently<T>(
        &mut self,
        loan: impl Fn(&Self) -> Result<T, LoanRefused>,
    ) -> Result<Option<T>, LoanRefused> {
        let mut told = None;
        let begin = Instant::now();
        loop {
            let waits =
                self.options.lossless || self.is_locked() && begin.elapsed() < LOCKSTEP_PATIENCE;
            match loan(self) {
                Ok(loan) => return Ok(Some(loan)),
                Err(LoanRefused::PoolInUse { .. }) if waits => {}
                Err(LoanRefused::PoolInUse { .. }) => return Ok(None),
                Err(other) => return Err(other),
            }
            if self.told_to_stop() {
                let since: &mut Instant = told.get_or_insert_with(Instant::now);
                if since.elapsed() >= LAST_WAIT {
                    return Ok(None);
                }
            }
            self.allowance.grant(LOSSLESS_WAIT.as_secs_f64());
            self.ports.wait(LOSSLESS_WAIT);
            self.answer();
            self.ports.maintain();
        }
    }

    pub(super) fn update_status(&mut self) -> Result<(), ServeError> {
        let mut status = self.output.status(self.world.report(), &self.summary);
        status.has_changes = u32::from(self.ports.can_send_changes());
        Ok(self.ports.update_status(&status)?)
    }
}

fn frame_header(report: &StepReport, flags: u32) -> FrameHeader {
    FrameHeader {
        step: report.step,
        sim_time: report.sim_time,
        dt: report.dt,
        state_hash: report.state_hash,
        substeps: report.substeps,
        flags,
        ..FrameHeader::default()
    }
}
