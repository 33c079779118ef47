//! Services that a killed server left unfinished.

use std::{fs, io, os::unix::fs::PermissionsExt, path::PathBuf};

use iceoryx2::{prelude::*, service::service_hash::ServiceHash};

use crate::{Service, domain::other_transports, session::OpenError};

/// Makes a service, over such remains if need be. Only the holder of the session's lock calls it.
pub(crate) fn make<P>(
    node: &Node<Service>,
    name: &ServiceName,
    pattern: MessagingPattern,
    mut open_or_create: impl FnMut() -> Result<P, OpenError>,
) -> Result<P, OpenError> {
    let error = match open_or_create() {
        Err(OpenError::Absent) => OpenError::Absent,
        Err(OpenError::Corrupted) if other_transports(node.config()).is_empty() => {
            OpenError::Corrupted
        }
        other => return other,
    };
    // Nobody can open an unfinished service, and iceoryx2 knows no node to clean up after.
    tracing::warn!(%name, ?error, "removing what a killed server left unfinished");
    // SAFETY: processes that use a service have opened it, which this one does not permit; and no process is
    // about to finish it, because only servers make services and this one holds the session's lock.
    let removed = unsafe { node.force_remove_service(name, pattern) }
        .map_err(|error| format!("{error:?}"))
        .and_then(|_| remove_unfinished(node, name, pattern).map_err(|error| error.to_string()));
    match removed {
        Ok(()) => open_or_create(),
        Err(reason) => Err(OpenError::Other(format!("{name} is damaged: {reason}"))),
    }
}

/// Removes a description that was never finished, which `force_remove_service` takes for none. Unfinished ones
/// can be told by their mode.
fn remove_unfinished(
    node: &Node<Service>,
    name: &ServiceName,
    pattern: MessagingPattern,
) -> io::Result<()> {
    type Hasher = <Service as iceoryx2::service::Service>::ServiceNameHasher;
    let global = &node.config().global;
    let hash = ServiceHash::new::<Hasher>(name, pattern);
    let suffix = &global.service.static_config_storage_suffix;
    let file = PathBuf::from(global.service_dir().to_string()).join(format!(
        "{}{}{suffix}",
        global.prefix,
        hash.as_str()
    ));
    match fs::metadata(&file) {
        Ok(found) if found.permissions().mode() & 0o777 == 0o600 => fs::remove_file(&file),
        Ok(_) => Ok(()),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        Err(error) => Err(error),
    }
}
