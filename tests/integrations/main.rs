//! The SDKs for other languages, each as a program of that language meets it: compiled or loaded, and run
//! against a real daemon. Tests that need packages from the network are run by `make integrations`.

mod c_sdk;
mod frozen;
mod node_sdk;
mod probe;
mod python_sdk;
mod rust_builders;
mod support;
