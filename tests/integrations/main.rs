//! The SDKs for other languages, each as a program of that language meets it: compiled or loaded, and run
//! against a real daemon. What needs packages from the network has a command of its own, `make integrations`.

mod c_sdk;
mod node_sdk;
mod probe;
mod python_sdk;
mod rust_builders;
mod support;
