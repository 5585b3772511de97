//! Documents, as structs that serde writes.

use serde::Serialize;
use serde_json::Value;

pub(crate) use isotherm_fit::view;

/// The document that serde makes of a view.
pub(crate) fn value(view: &impl Serialize) -> Value {
    // It fails only for maps whose keys are not texts. No view has such a map.
    serde_json::to_value(view).unwrap_or_default()
}
