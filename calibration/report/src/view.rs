//! Documents, as structs that serde writes.

use serde::Serialize;
use serde_json::Value;

/// Declares a struct for a document: each key once, with its type and where its value comes from. `of` makes it of the
/// results in brackets. An unknown value is `None`, which is null in JSON, and so is a number that is not finite.
macro_rules! view {
    ($(#[$about:meta])* $visible:vis $name:ident $(<$life:lifetime>)? ($($result:ident: $of:ty),*) {
        $($(#[$attribute:meta])* $key:ident: $type:ty = $value:expr,)*
    }) => {
        $(#[$about])*
        #[derive(serde::Serialize)]
        $visible struct $name $(<$life>)? {
            $($(#[$attribute])* $key: $type,)*
        }

        impl $(<$life>)? $name $(<$life>)? {
            $visible fn of($($result: $of),*) -> Self {
                Self { $($key: $value,)* }
            }
        }
    };
}
pub(crate) use view;

/// The document that serde makes of a view.
pub(crate) fn value(view: &impl Serialize) -> Value {
    // It fails for maps alone whose keys are no texts. No view has such a map.
    serde_json::to_value(view).unwrap_or_default()
}
