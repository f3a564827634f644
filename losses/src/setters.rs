//! Setters of option structs that outside crates cannot build field by field (`#[non_exhaustive]`).

/// `with_field(self, field) -> Self` for each field.
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
