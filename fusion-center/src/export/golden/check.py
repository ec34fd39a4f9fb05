"""Reads the golden files with programs that are not ours; README.md says how to run it."""

import csv
import json
import math
import sys
import xml.etree.ElementTree as plain

import asterix
from lxml import etree

POSITIONS = {
    7: (40.78919233, 111.72843044),
    8: (40.80827581, 111.65876405),
    9: (40.81746626, 111.69004512),
    70000: (-16.5, -179.998),
}
KML = "{http://www.opengis.net/kml/2.2}"
GX = "{http://www.google.com/kml/ext/2.2}"


def geojson():
    with open("tracks.geojson") as file:
        collection = json.load(file)
    assert collection["type"] == "FeatureCollection"
    for feature in collection["features"]:
        kind, geometry = feature["properties"]["kind"], feature["geometry"]
        lines = flat(geometry["coordinates"])
        assert all(-180 <= lon <= 180 and -90 <= lat <= 90 for lon, lat, *_ in lines)
        if kind == "position":
            lat, lon = POSITIONS[feature["properties"]["track"]]
            assert geometry["coordinates"][:2] == [lon, lat]
        if kind == "ellipse":
            polygons = geometry["coordinates"]
            for rings in polygons if geometry["type"] == "MultiPolygon" else [polygons]:
                assert all(ring[0] == ring[-1] and turn(ring) > 0 for ring in rings)
                assert all(abs(a[0] - b[0]) < 1 for ring in rings for a, b in zip(ring, ring[1:]))
    return len(collection["features"])


def flat(coordinates):
    if isinstance(coordinates[0], (int, float)):
        return [coordinates]
    return [place for part in coordinates for place in flat(part)]


def turn(ring):
    return sum(a[0] * b[1] - a[1] * b[0] for a, b in zip(ring, ring[1:]))


def kml(schema_folder):
    schema = etree.XMLSchema(etree.parse(schema_folder + "/kml22gx.xsd"))
    schema.assertValid(etree.parse("tracks.kml"))
    tracks = list(plain.parse("tracks.kml").iter(GX + "Track"))
    for track in tracks:
        places = [text.text.split() for text in track.iter(GX + "coord")]
        assert len(places) == len(list(track.iter(KML + "when")))
        assert any(
            math.dist((float(places[-1][1]), float(places[-1][0])), at) < 1e-7
            for at in POSITIONS.values()
        )
    return len(tracks)


def cot(schema_file):
    schema = etree.XMLSchema(etree.parse(schema_file))
    with open("events.cot", "rb") as file:
        events = [etree.fromstring(line) for line in file]
    for event in events:
        schema.assertValid(event)
        for element in event.find("detail"):
            schema.assertValid(element)
        point = event.find("point")
        track = int(event.find("detail/contact").get("callsign")[1:])
        assert (float(point.get("lat")), float(point.get("lon"))) == POSITIONS[track]
    assert events[3].get("uid") == "ship <\"A\" & 'B'>, quay; 3"
    return len(events)


def table():
    with open("tracks.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        assert (float(row["lat_deg"]), float(row["lon_deg"])) == POSITIONS[int(row["track"])]
    assert rows[3]["name"] == "ship <\"A\" & 'B'>, quay; 3"
    return len(rows)


def cat062():
    with open("tracks.cat062.hex") as file:
        records = asterix.parse(bytes.fromhex(file.read()))
    for record, (number, (lat, lon)) in zip(records, zip(range(1000, 1004), POSITIONS.values())):
        value = lambda item, field: record[item][field]["val"]
        assert record["category"] == 62
        assert (value("I010", "SAC"), value("I010", "SIC"), value("I040", "TrkN")) == (25, 201, number)
        assert value("I070", "ToT") == 43240.0
        assert abs(value("I105", "Lat") - lat) < 3e-6 and abs(value("I105", "Lon") - lon) < 3e-6
    vx = [record["I185"]["Vx"]["val"] for record in records]
    vy = [record["I185"]["Vy"]["val"] for record in records]
    assert (vx, vy) == ([10.0, -12.0, 4.0, 0.0], [7.5, 3.0, -14.0, 0.0])
    status = [record["I080"] for record in records]
    bits = lambda name: [one[name]["val"] for one in status]
    assert bits("MON") == [1, 1, 0, 1] and bits("CNF") == [0, 1, 0, 0]
    assert bits("TSB") == [1, 0, 0, 0] and bits("TSE") == [0, 0, 0, 1]
    assert bits("CST") == [0, 0, 1, 0] and bits("SFC") == [1] * 4 and bits("SIM") == [1] * 4
    assert bits("SDS") == [2] * 4 and bits("SRC") == [2, 6, 2, 2] and bits("MRH") == [1] * 4
    first = records[0]["I500"]
    assert [first["APC"][name]["val"] for name in ("APC_X", "APC_Y")] == [30.0, 20.0]
    assert first["COV"]["COV_XY"]["val"] == 20.5
    assert [first["ATV"][name]["val"] for name in ("ATV_X", "ATV_Y")] == [2.0, 1.5]
    assert abs(first["AGA"]["AGA_Acc"]["val"] * 0.3048 - 15) < 1
    assert abs(records[0]["I130"]["Alt"]["val"] * 0.3048 - 1050) < 1
    assert records[2]["I290"]["PSR"]["PSR"]["val"] == 10.0
    assert records[2]["I290"]["TRK"]["TRK"]["val"] == 40.0
    return len(records)


if __name__ == "__main__":
    kml_schemas, cot_schema = sys.argv[1:]
    print("features", geojson(), "ways", kml(kml_schemas), "events", cot(cot_schema))
    print("rows", table(), "records", cat062())
