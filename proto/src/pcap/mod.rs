//! What UDP and TCP carried in a capture of network traffic (pcap, pcapng), frame by frame.
//!
//! Classic captures of both byte orders, in micro- and nanoseconds, and pcapng, by `pcap-parser`;
//! Ethernet with VLAN tags, raw IP, Linux cooked (both versions) and loopback, IPv4 and IPv6, UDP
//! and TCP, by `etherparse`. Fragments of IP are put together; bytes of one TCP connection are put
//! in order by [`TcpStream`]. Not handled: tunnels, checksums (captures often lack them), frames
//! that were cut when they were captured; each is counted in [`Counts`].

mod capture;
mod fragments;
mod frame;
mod tcp;

#[cfg(test)]
mod tests;

pub use capture::{Capture, CaptureError};
pub use frame::{Content, Counts, Payload};
pub use tcp::TcpStream;
