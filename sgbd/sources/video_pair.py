"""Read frames from a colour video and a depth video."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from sgbd.frame import MILLIMETERS, Frame, Intrinsics
from sgbd.sources.camera import intrinsics_from, intrinsics_option
from sgbd.sources.errors import FrameReadError, MissingExtraError
from sgbd.sources.image import checked_depth_scale
from sgbd.sources.notices import info_once
from sgbd.sources.source import FrameSource
from sgbd.sources.time_association import associate

if TYPE_CHECKING:
    from av import VideoFrame
    from av.container import InputContainer

log = logging.getLogger(__name__)

VIDEO_SUFFIXES = (".avi", ".m4v", ".mkv", ".mov", ".mp4", ".nut", ".webm")
"""File suffixes of videos, in lower case."""

_DEEP_GRAY = re.compile(r"gray(?:9|10|12|14|16)(?P<order>le|be)")


class VideoPair(FrameSource):
    """A colour video and a depth video, read one frame at a time.

    Read the frames in order: going back to an earlier frame means decoding from the start again. If both videos have
    the same number of frames, they are paired by position. Otherwise two frames form a pair if each is the other's
    nearest in time since the start of its video, within half a frame period; a warning counts the others. Frames that
    the decoder reports as damaged, and frames that depend on them, cannot be read. FFmpeg's FFV1 decoder detects only
    some damage and otherwise repeats the previous content.

    The depth video needs a single channel of more than 8 bits (gray16le, gray12le, ...) and a lossless codec such as
    FFV1: `ffmpeg -i depth/%06d.png -c:v ffv1 -g 1 -pix_fmt gray16le depth.mkv`.
    Reading needs `pip install 'sgbd[video]'`.

    Args:
        rgb: Colour video; rotation metadata is not applied.
        depth: Depth video, registered to the colours, 0 = missing.
        intrinsics: Camera of all frames; None if unknown.
        depth_scale: Metres per unit of the depth.

    Raises:
        ValueError: If the scale is not positive.
        FrameError: If `intrinsics` is not a valid camera.
    """

    def __init__(
        self,
        rgb: str | Path,
        depth: str | Path,
        intrinsics: Intrinsics | Mapping[str, Any] | None = None,
        depth_scale: float = MILLIMETERS,
    ) -> None:
        self.split = "test"
        self.rgb = Path(rgb).expanduser()
        self.depth = Path(depth).expanduser()
        self.intrinsics = intrinsics_from(intrinsics)
        self.depth_scale = checked_depth_scale(depth_scale)
        self._decoders: tuple[_Decoder, _Decoder] | None = None

    def __getstate__(self) -> dict[str, Any]:
        # Open files cannot be sent to another process.
        return self.__dict__ | {"_decoders": None}

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Name of the colour video with the frame number, from 0, e.g. clip_000012."""
        stem = self.rgb.stem
        for ending in ("_rgb", "_color", "_colour"):
            stem = stem.removesuffix(ending)
        return tuple(f"{stem}_{place:06d}" for place in self._places[0].tolist())

    @property
    def splits(self) -> tuple[str, ...]:
        """The only split, "test"."""
        return ("test",)

    def files(self, index: int) -> tuple[Path, ...]:
        """Return the two videos."""
        return (self.rgb, self.depth)

    def options(self) -> Mapping[str, Any]:
        """Return the options that affect what is read."""
        return {
            "intrinsics": intrinsics_option(self.intrinsics),
            "depth_scale": self.depth_scale,
        }

    def read(self, index: int) -> Frame:
        """Decode a frame.

        Raises:
            FrameReadError: If the frame is damaged or a video is of the wrong kind.
            MissingExtraError: If PyAV is not installed.
            sgbd.frame.FrameError: If the two images do not form a valid frame.
        """
        if self._decoders is None:
            self._decoders = (_Decoder(self.rgb, self._streams[0]), _Decoder(self.depth, self._streams[1]))
        color, distance = (
            decoder.decode(int(places[index])) for decoder, places in zip(self._decoders, self._places, strict=True)
        )
        rgb = np.asarray(color.to_ndarray(format="rgb24"), np.uint8)
        depth = _gray_values(distance, self.depth).astype(np.float32) * np.float32(self.depth_scale)
        return Frame(rgb, depth, self.intrinsics, name=self.names[index])

    def close(self) -> None:
        """Close the files; reading reopens them."""
        for decoder in self._decoders or ():
            decoder.close()
        self._decoders = None

    @cached_property
    def _streams(self) -> tuple[_Stream, _Stream]:
        """Properties of the colour and the depth video, read without decoding."""
        rgb, depth = _stream(self.rgb), _stream(self.depth)
        if _DEEP_GRAY.fullmatch(rgb.pixels):
            raise FrameReadError(
                self.rgb, f"a video of colours is expected, this one is {rgb.pixels}; are rgb and depth swapped?"
            )
        _depth_order(depth.pixels, self.depth)
        if rgb.size != depth.size:
            raise FrameReadError(
                self.depth,
                f"the depth has {depth.size[0]}x{depth.size[1]} pixels and the colours {rgb.size[0]}x{rgb.size[1]}; "
                "both must be of one size and registered to each other. Align the depth to the colour camera first.",
            )
        if not depth.lossless:
            log.warning(
                "%s: %s changes the values it stores; edges of objects suffer. Use FFV1 for depth.",
                self.depth, depth.codec,
            )  # fmt: skip
        return rgb, depth

    @cached_property
    def _places(self) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Positions of the paired frames in the colour video and in the depth video."""
        rgb, depth = self._streams
        info_once(
            log, "%s, %s: %d and %d frames; the depth (%s, %s) has %g units a metre (option: depth_scale, now %g)%s",
            self.rgb, self.depth, rgb.times.size, depth.times.size, depth.codec, depth.pixels, 1 / self.depth_scale,
            self.depth_scale,
            "" if self.intrinsics else "; the camera is unknown, a horizontal view of 59° is assumed "
            "(option: intrinsics)",
        )  # fmt: skip
        half_a_frame = min(rgb.period, depth.period) / 2
        if rgb.times.size == depth.times.size:
            apart = np.abs(rgb.times - depth.times).max()
            if apart > half_a_frame:
                log.warning(
                    "%s, %s: the times of their frames are up to %.2f s apart; as both have %d frames, they are paired "
                    "by order",
                    self.rgb, self.depth, apart, rgb.times.size,
                )  # fmt: skip
            order = np.arange(rgb.times.size)
            return order, order
        # Add 1 ms because files store rounded times (Matroska: milliseconds).
        places = associate(rgb.times, depth.times, half_a_frame + 1e-3)
        log.warning(
            "%s has %d frames (%.4g a second), %s %d (%.4g a second); %d pairs of equal time are used, the others are "
            "left out",
            self.rgb, rgb.times.size, 1 / rgb.period, self.depth, depth.times.size, 1 / depth.period, places[0].size,
        )  # fmt: skip
        return places


@dataclass(frozen=True, eq=False)
class _Stream:
    """Properties of a video.

    Attributes:
        ticks: int64 [N], time stamps of the frames in presentation order, in the stream's time unit; None if the file
            has no usable time stamps, so that frames must be counted.
        times: float64 [N], seconds since the first frame.
        period: Median time between frames, seconds.
        size: Width and height in pixels.
        pixels: Pixel format, such as gray16le; empty if unknown before decoding.
        codec: Name of the codec.
        lossless: Whether the codec can store values without loss.
    """

    ticks: npt.NDArray[np.int64] | None
    times: npt.NDArray[np.float64]
    period: float
    size: tuple[int, int]
    pixels: str
    codec: str
    lossless: bool


def _open(path: Path) -> InputContainer:
    try:
        # Imported here because it is an optional dependency.
        import av
    except ImportError as error:
        raise MissingExtraError(
            f"videos are read with PyAV, which cannot be imported ({error}). "
            "Install the extra: pip install 'sgbd[video]'."
        ) from error
    try:
        container = av.open(str(path))
    except FileNotFoundError:
        raise FrameReadError(path, "the file does not exist") from None
    except (av.FFmpegError, OSError) as error:
        raise FrameReadError(
            path, f"this is no video that can be opened, or a damaged one ({error}); copy or export it again"
        ) from error
    if not container.streams.video:
        container.close()
        raise FrameReadError(path, "there is no video in it")
    return container


def _stream(path: Path) -> _Stream:
    container = _open(path)
    import av

    with container:
        stream = container.streams.video[0]
        context = stream.codec_context
        ticks: list[int | None] = []
        try:
            # An empty packet marks the end, and discarded packets give no frame. If demuxing fails midway, `extend`
            # keeps what was read before.
            ticks.extend(packet.pts for packet in container.demux(stream) if packet.size and not packet.is_discard)
        except av.FFmpegError as error:
            log.warning("%s: damaged after %d frames (%s); what comes before is used", path, len(ticks), error)
        if not ticks:
            raise FrameReadError(path, "there is no frame in it")
        known = np.array([tick for tick in ticks if tick is not None], np.int64)
        stamped = known.size == len(ticks) == np.unique(known).size and stream.time_base is not None
        rate = float(stream.average_rate or stream.guessed_rate or 30)
        times = np.sort(known) * float(stream.time_base or 0) if stamped else np.arange(len(ticks)) / rate
        return _Stream(
            ticks=np.sort(known) if stamped else None,
            times=times - times[0],
            period=float(np.median(np.diff(times))) if len(ticks) > 1 else 1 / rate,
            size=(context.width, context.height),
            pixels=context.pix_fmt or "",
            codec=context.codec.name,
            lossless=bool(context.codec.lossless),
        )


@dataclass(eq=False)
class _Decoder:
    """Decodes one video sequentially; restarts from the beginning if an earlier frame is requested."""

    path: Path
    stream: _Stream
    _container: InputContainer | None = None
    _decoded: Iterator[tuple[int, VideoFrame | None]] = field(default_factory=lambda: iter(()))
    _last: tuple[int, VideoFrame | None] | None = None
    _passed: int = -1

    def decode(self, place: int) -> VideoFrame:
        """Return frame number `place` of the video.

        Raises:
            FrameReadError: If it cannot be decoded completely.
        """
        if self._container is None or place < self._passed:
            self.close()
            self._container = _open(self.path)
            self._decoded = self._frames(self._container)
        self._passed = place
        while self._last is None or self._last[0] < place:
            self._last = next(self._decoded, None)
            if self._last is None:
                break
        frame = self._last[1] if self._last is not None and self._last[0] == place else None
        if frame is None:
            raise FrameReadError(self.path, f"frame {place} is damaged, or a frame that it builds on is")
        return frame

    def close(self) -> None:
        """Close the file."""
        if self._container is not None:
            self._container.close()
        self._container, self._last, self._passed = None, None, -1
        self._decoded = iter(())

    def _frames(self, container: InputContainer) -> Iterator[tuple[int, VideoFrame | None]]:
        """Yield the number of each decoded frame with the frame itself, or with None if it is affected by damage."""
        import av

        counted, damaged = 0, False
        stream = container.streams.video[0]
        if _DEEP_GRAY.fullmatch(self.stream.pixels):
            # Decoders conceal damage. That is acceptable for colours, but it would invent depth values.
            stream.codec_context.options = {"err_detect": "crccheck+explode"}
        packets = container.demux(stream)
        while True:
            try:
                packet = next(packets)
            except (StopIteration, av.FFmpegError):
                return
            try:
                frames = packet.decode()
            except av.FFmpegError:
                # Without time stamps, count the packet's frame as missing to keep the numbering right.
                counted, damaged = counted + 1, True
                continue
            for frame in frames:
                place = self._place(frame, counted)
                counted += 1
                # Damage spreads to all following frames up to the next key frame.
                damaged = bool(frame.is_corrupt or (damaged and not frame.key_frame))
                if place is not None:
                    yield place, None if damaged else frame

    def _place(self, frame: VideoFrame, counted: int) -> int | None:
        ticks = self.stream.ticks
        if ticks is None:
            return counted
        if frame.pts is None:
            return None
        place = int(np.searchsorted(ticks, frame.pts))
        return place if place < ticks.size and ticks[place] == frame.pts else None


def _depth_order(pixels: str, path: Path) -> str:
    """Return the byte order of the depth values, "<" or ">".

    Raises:
        FrameReadError: If the pixel format cannot hold depth.
    """
    match = _DEEP_GRAY.fullmatch(pixels)
    if match is None:
        raise FrameReadError(
            path,
            f"the depth needs one channel of more than 8 bits, such as gray16le; this video has {pixels or 'none'} "
            "(a picture made for viewing?). Store the sensor's values without loss: "
            "ffmpeg -i depth/%06d.png -c:v ffv1 -g 1 -pix_fmt gray16le depth.mkv",
        )
    return "<" if match["order"] == "le" else ">"


def _gray_values(frame: VideoFrame, path: Path) -> npt.NDArray[np.uint16]:
    """Return the stored values of a frame, uint16 [H, W]."""
    order = _depth_order(frame.format.name, path)
    plane = frame.planes[0]
    # Rows may be padded beyond the image width.
    rows = np.frombuffer(memoryview(plane), np.dtype(f"{order}u2")).reshape(-1, plane.line_size // 2)
    return rows[: frame.height, : frame.width]
