//! Which time constant the lagged temperature of an acquisition has.

use isotherm_shared::time_constant::TimeConstant;

/// Which time constant the lagged temperature has that an acquisition sends.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub enum LagOption {
    /// That of the table in force, from the status of the service: as it is when the acquisition connects, and again
    /// when an increment is flagged [`Flags::LAG_UNKNOWN`](isotherm_shared::wire::Flags::LAG_UNKNOWN). If the table has
    /// another one after a reload, samples are flagged until the next readings have found the new one. Connecting waits
    /// for the status beyond its time-out, 0.1 s or less, and 1 s for a service that hangs.
    #[default]
    Service,
    /// This one, whatever the table's is.
    Fixed(TimeConstant),
    /// The library keeps no lag. `lag_ns` and `head_lagged` are sent as the application fills them in.
    None,
}
