//! From a captured frame to what UDP or TCP carried in it.

use std::net::{IpAddr, SocketAddr};

use etherparse::{EtherType, NetSlice, SlicedPacket, TcpSlice, TransportSlice, UdpSlice};
use pcap_parser::Linktype;

use super::fragments::{Fragment, Fragments};

/// What one UDP datagram or one TCP segment carried.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Payload {
    /// When it was captured, nanoseconds of Unix time; 0 where the capture does not say.
    pub time_ns: i64,
    /// Who sent it.
    pub source: SocketAddr,
    /// For whom it was.
    pub destination: SocketAddr,
    /// What it carried.
    pub content: Content,
}

/// What it carried, and by which protocol.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Content {
    /// A whole datagram.
    Udp(Vec<u8>),
    /// A piece of a connection; see [`TcpStream`](super::TcpStream).
    Tcp {
        /// Number of the first byte; of the byte before it where `starts`.
        sequence: u32,
        /// Whether the connection starts here.
        starts: bool,
        /// The bytes.
        bytes: Vec<u8>,
    },
}

/// What was seen in a capture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// All frames.
    pub frame_count: u64,
    /// Whole UDP datagrams.
    pub udp_count: u64,
    /// Pieces of TCP connections.
    pub tcp_count: u64,
    /// Frames with a fragment of a datagram.
    pub fragment_count: u64,
    /// Datagrams of which fragments are missing.
    pub unfinished_count: u64,
    /// Frames that the capture holds only the beginning of.
    pub cut_count: u64,
    /// Frames with something else than UDP or TCP.
    pub other_count: u64,
    /// Frames whose headers make no sense.
    pub unreadable_count: u64,
    /// Frames of a kind of link that is not known here.
    pub unknown_link_count: u64,
}

/// A frame of a capture.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame<'a> {
    pub(super) time_ns: i64,
    pub(super) link: Linktype,
    pub(super) bytes: &'a [u8],
    pub(super) is_cut: bool,
}

/// Takes frames apart, with the fragments of earlier ones.
#[derive(Debug, Default)]
pub(super) struct Frames {
    counts: Counts,
    fragments: Fragments,
}

/// Why a frame gives nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Useless {
    Unreadable,
    UnknownLink,
    Other,
    /// A fragment whose datagram is not complete.
    Waiting,
}

impl Frames {
    pub(super) fn counts(&self) -> Counts {
        Counts { unfinished_count: self.fragments.unfinished_count(), ..self.counts }
    }

    /// What the frame carried; none, and counted, if that is of no use.
    pub(super) fn payload(&mut self, frame: &Frame<'_>) -> Option<Payload> {
        self.counts.frame_count += 1;
        if frame.is_cut {
            self.counts.cut_count += 1;
            return None;
        }
        let payload = self.open(frame);
        let counter = match &payload {
            Ok(Payload { content: Content::Udp(_), .. }) => &mut self.counts.udp_count,
            Ok(Payload { content: Content::Tcp { .. }, .. }) => &mut self.counts.tcp_count,
            Err(Useless::Unreadable) => &mut self.counts.unreadable_count,
            Err(Useless::UnknownLink) => &mut self.counts.unknown_link_count,
            Err(Useless::Other) => &mut self.counts.other_count,
            Err(Useless::Waiting) => return None,
        };
        *counter += 1;
        payload.ok()
    }

    fn open(&mut self, frame: &Frame<'_>) -> Result<Payload, Useless> {
        let packet = slice(frame.link, frame.bytes)?;
        let [source, destination] = addresses(&packet).ok_or(Useless::Other)?;
        let between = Between { time_ns: frame.time_ns, source, destination };
        if let Some(fragment) = Fragment::of(&packet) {
            self.counts.fragment_count += 1;
            let whole = self.fragments.add(&fragment).ok_or(Useless::Waiting)?;
            let udp = UdpSlice::from_slice(&whole).map_err(|_unreadable| Useless::Unreadable)?;
            return Ok(between.udp(&udp));
        }
        match &packet.transport {
            Some(TransportSlice::Udp(udp)) => Ok(between.udp(udp)),
            Some(TransportSlice::Tcp(tcp)) => Ok(between.tcp(tcp)),
            _ => Err(Useless::Other),
        }
    }
}

/// The headers of a frame.
fn slice(link: Linktype, bytes: &[u8]) -> Result<SlicedPacket<'_>, Useless> {
    /// Before the packet: the address family of the sender's system.
    const LOOPBACK_HEADER_BYTES: usize = 4;
    /// Before the packet: its protocol, and how the interface saw it.
    const COOKED_2_HEADER_BYTES: usize = 20;

    let after = |count: usize| bytes.get(count..).ok_or(Useless::Unreadable);
    let sliced = match link {
        Linktype::ETHERNET => SlicedPacket::from_ethernet(bytes),
        Linktype::LINUX_SLL => SlicedPacket::from_linux_sll(bytes),
        Linktype::NULL | Linktype::LOOP => SlicedPacket::from_ip(after(LOOPBACK_HEADER_BYTES)?),
        // 12 and 14 are how some systems write raw IP.
        Linktype(12 | 14) | Linktype::RAW | Linktype::IPV4 | Linktype::IPV6 => {
            SlicedPacket::from_ip(bytes)
        }
        Linktype(276) => {
            let protocol =
                EtherType(u16::from_be_bytes(*bytes.first_chunk().ok_or(Useless::Unreadable)?));
            SlicedPacket::from_ether_type(protocol, after(COOKED_2_HEADER_BYTES)?)
        }
        _ => return Err(Useless::UnknownLink),
    };
    sliced.map_err(|_unreadable| Useless::Unreadable)
}

/// Source and destination.
fn addresses(packet: &SlicedPacket<'_>) -> Option<[IpAddr; 2]> {
    match packet.net.as_ref()? {
        NetSlice::Ipv4(ip) => {
            let header = ip.header();
            Some([header.source_addr().into(), header.destination_addr().into()])
        }
        NetSlice::Ipv6(ip) => {
            let header = ip.header();
            Some([header.source_addr().into(), header.destination_addr().into()])
        }
        NetSlice::Arp(_) => None,
    }
}

/// When, from where and to where.
struct Between {
    time_ns: i64,
    source: IpAddr,
    destination: IpAddr,
}

impl Between {
    fn udp(&self, udp: &UdpSlice<'_>) -> Payload {
        let ports = [udp.source_port(), udp.destination_port()];
        self.payload(ports, Content::Udp(udp.payload().to_vec()))
    }

    fn tcp(&self, tcp: &TcpSlice<'_>) -> Payload {
        let (sequence, starts) = (tcp.sequence_number(), tcp.syn());
        let content = Content::Tcp { sequence, starts, bytes: tcp.payload().to_vec() };
        self.payload([tcp.source_port(), tcp.destination_port()], content)
    }

    fn payload(&self, [source_port, destination_port]: [u16; 2], content: Content) -> Payload {
        Payload {
            time_ns: self.time_ns,
            source: SocketAddr::new(self.source, source_port),
            destination: SocketAddr::new(self.destination, destination_port),
            content,
        }
    }
}
