//! Promise: wide-area radars make one map; an agent that dies and comes back costs nobody else
//! anything, and garbage on the network is counted and passed over.

use std::net::UdpSocket;
use std::os::unix::process::CommandExt;
use std::process::{Command, Stdio};
use std::time::Duration;

use proto::stanag4607::packets;

use super::support::{Run, eventually};

#[test]
fn two_radars_make_one_map_though_one_dies_on_the_way() {
    let finished = Run::new(&["wide-area", "--speed", "16", "--kill", "east@4"]).finish();
    let report = &finished.report;
    assert!(finished.output.status.success(), "{}\n{report}", finished.stderr());
    assert_eq!((&report["target_count"], &report["found_count"]), (&4.into(), &4.into()));
    let incidents = report["incidents"].as_array().unwrap();
    assert!(incidents.len() == 1 && incidents[0]["who"] == "east", "{incidents:?}");
    // 40 dwells of each, less those that were on the way when it died; none twice.
    let dwell_count = report["counts"]["dwell_count"].as_u64().unwrap();
    assert!((70..=80).contains(&dwell_count), "{report}");
    assert_eq!(report["counts"]["refused_count"], 0);
    let picture = std::fs::read_to_string(finished.path("map.svg")).unwrap();
    assert!(picture.starts_with("<svg"));
}

/// A packet by hand: header, a mission segment and nothing else is enough for a live agent to go on.
fn mission_packet() -> Vec<u8> {
    let mut packet = b"30".to_vec();
    packet.extend(76_u32.to_be_bytes());
    packet.extend(b"XN\x05XN\x00\x00\x00radar     ");
    packet.extend([0; 8]);
    packet.push(1);
    packet.extend(44_u32.to_be_bytes());
    packet.extend(b"plan        flight      \x00config    ");
    packet.extend(2023_u16.to_be_bytes());
    packet.extend([11, 14]);
    packet
}

#[test]
fn garbage_on_udp_is_named_in_the_log_and_the_agent_goes_on() -> anyhow::Result<()> {
    let good = mission_packet();
    assert!(packets(&good).all(|packet| packet.is_ok()), "{:?}", packets(&good).next());
    let folder = tempfile::tempdir()?;
    let log = folder.path().join("agent.log");
    let port = UdpSocket::bind(("127.0.0.1", 0))?.local_addr()?.port();
    let mut agent = Command::new(env!("CARGO_BIN_EXE_transmural-under-test"))
        .arg0("node-agent")
        .args(["--connect", "tcp/127.0.0.1:9", "--stop-with-stdin"])
        .args(["--set", "kind=gmti", "--set", "gmti.source=udp"])
        .args(["--set", &format!("gmti.address=127.0.0.1:{port}")])
        .stdin(Stdio::piped())
        .stderr(std::fs::File::create(&log)?)
        .spawn()?;
    let logged = |text: &str| std::fs::read_to_string(&log).is_ok_and(|log| log.contains(text));
    eventually("the agent listens", Duration::from_secs(15), || logged("waiting for datagrams"));
    let sender = UdpSocket::bind(("127.0.0.1", 0))?;
    let to = ("127.0.0.1", port);
    for bytes in [&b"garbage"[..], &good[..40], &good, &[0xff; 1400]] {
        sender.send_to(bytes, to)?;
    }
    eventually("damage is named", Duration::from_secs(5), || logged("message refused"));
    eventually("and counted", Duration::from_secs(5), || logged("count=2"));
    assert!(agent.try_wait()?.is_none(), "the agent has ended");
    drop(agent.stdin.take());
    assert!(agent.wait()?.success());
    Ok(())
}
