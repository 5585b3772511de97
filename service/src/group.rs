//! The group of users that a domain belongs to, as the configuration names it.

use iceoryx2_bb_posix::group::GroupExt as _;
use isotherm_client::{Domain, give_to_group};
use isotherm_support::failure::{Exit, Failure};
use rustix::process::{getegid, geteuid, getgroups};

/// Makes the domain belong to the configured group, or to its own user.
///
/// # Errors
/// Why it cannot: the domain does not start half open.
pub(crate) fn apply(domain: &Domain, group: Option<&str>) -> Result<(), Failure> {
    let Some(name) = group else {
        return give_to_group(domain, None).map_err(|error| Failure::new(Exit::Io, error));
    };
    let failed = |cause: &str| Failure::new(Exit::Config, format!("domain.group = {name:?}: {cause}"));
    let number =
        number_of(name).ok_or_else(|| failed("there is no such group; make it, as with `groupadd --system`"))?;
    let mut own = getgroups().unwrap_or_default().into_iter().chain([getegid()]);
    if !geteuid().is_root() && !own.any(|group| group.as_raw() == number) {
        return Err(failed(
            "the service's user is not a member; add it (`usermod -aG`), or give the unit Group= or SupplementaryGroups=",
        ));
    }
    let remedy =
        "the drop-in group.conf makes the folder with systemd, whose RestrictSUIDSGID= keeps the service from doing it";
    give_to_group(domain, Some(number))
        .map_err(|cause| failed(&format!("{cause}; it must be 2770 and the group's: {remedy}")))
}

/// The number of a group that is given by name or number.
fn number_of(name: &str) -> Option<u32> {
    // Numbers first: the transport's search by name logs an error where there is none.
    name.parse().ok().or_else(|| Some(name.as_group().ok()?.gid().value()))
}
