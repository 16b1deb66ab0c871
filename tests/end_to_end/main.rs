//! End to end: the daemon, the renderer and the command line as separate processes.

mod backup;
mod browser;
mod carry;
mod dashboard;
mod exec;
mod exec_trouble;
mod faults;
mod flood;
mod guard;
mod local;
mod lockouts;
mod locks;
mod network;
mod power;
mod replicas;
mod replicas_tls;
mod restart;
mod sampling;
mod security;
mod site;
mod sockets;
mod storm;
mod tuning;
mod unit;
mod upgrade;
mod wire;
