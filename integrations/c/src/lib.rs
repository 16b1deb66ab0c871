//! `libtreewright`: the blocking client SDK behind a C interface.
//!
//! `include/treewright.h` is the interface and says for each function who owns which object. It is kept by
//! hand, and `tests/integrations/c_sdk.rs` compares it with the exports. This crate keeps to four rules:
//!
//! - A handle is a box. `NULL` is allowed wherever a handle is freed and is an error, never a crash,
//!   elsewhere. References and boxes in the signatures say what C has to keep: valid, aligned, not used by
//!   another thread at the same time unless the header says that it may be.
//! - There is no global state: a failure is handed out through the last argument of the call that failed.
//! - No panic leaves the library ([`edge::guard`]).
//! - `unsafe` code stands in [`edge`], where pointers from C become slices and text.

/// Exports functions to C, of four kinds:
///
/// - `fn name(arguments; error) -> answer` puts a failure of its body, or a panic, where C said last; see
///   [`edge::Answer`].
/// - `fn name(mut draft: Draft, arguments)` changes an [`edge::Draft`] and keeps a mistake for later.
/// - `fn name(handle: Type);` drops what C gives back.
/// - All others are exported as they are.
macro_rules! exports {
    () => {};
    (fn $name:ident($handle:ident: $kind:ty); $($rest:tt)*) => {
        #[unsafe(no_mangle)]
        pub(crate) extern "C" fn $name($handle: Option<Box<$kind>>) {
            $crate::edge::free($handle);
        }
        exports! { $($rest)* }
    };
    (fn $name:ident(mut $draft:ident: $kind:ty $(, $argument:ident: $type:ty)*) $body:block $($rest:tt)*) => {
        #[unsafe(no_mangle)]
        pub(crate) extern "C" fn $name($draft: Option<&mut $kind>, $($argument: $type),*) {
            $crate::edge::change($draft, |$draft| {
                $body;
                Ok(())
            });
        }
        exports! { $($rest)* }
    };
    (fn $name:ident($($argument:ident: $type:ty),*; $error:ident) -> $answer:ty $body:block $($rest:tt)*) => {
        #[unsafe(no_mangle)]
        pub(crate) extern "C" fn $name($($argument: $type,)* $error: $crate::edge::ErrorOut) -> $answer {
            <$answer as $crate::edge::Answer>::of($crate::edge::guard($error, || $body))
        }
        exports! { $($rest)* }
    };
    (fn $name:ident($($argument:ident: $type:ty),*) $(-> $answer:ty)? $body:block $($rest:tt)*) => {
        #[unsafe(no_mangle)]
        pub(crate) extern "C" fn $name($($argument: $type),*) $(-> $answer)? $body
        exports! { $($rest)* }
    };
}

mod client;
mod configuration;
mod edge;
mod error;
mod front;
mod options;
mod scene;
mod spec;
mod study;
mod suggestion;
