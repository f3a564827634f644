//! Setters of option structs that outside crates cannot build field by field (`#[non_exhaustive]`): of the crates above, not of
//! this one's interface.

/// `with_field(self, field) -> Self` for each field.
#[doc(hidden)]
#[macro_export]
macro_rules! setters {
    ($($with:ident $field:ident: $type:ty;)+) => { $(
        #[doc = concat!("The same settings with another `", stringify!($field), "`.")]
        #[must_use]
        pub const fn $with(mut self, $field: $type) -> Self {
            self.$field = $field;
            self
        }
    )+ };
}
