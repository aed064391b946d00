"""Compiled per-pixel passes of the renderer: surface points, secondary rays, light smoothing and reflection."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from sgbd.machine.compiled import compiled

Floats = npt.NDArray[np.float32]
Integers = npt.NDArray[np.int32]


@compiled
def surface_points(
    eye: Floats,
    rays: Floats,
    lengths: Floats,
    triangle: Integers,
    u: Floats,
    v: Floats,
    geometric: Floats,
    corner_normals: Floats,
    triangle_part: Integers,
    lift: float,
    part: Integers,
    depth: Floats,
    points: Floats,
    starts: Floats,
    normals: Floats,
    facing: Floats,
) -> None:
    """Find the surface point, normal and part hit by each ray.

    Args:
        eye: float32 [3], origin of the rays.
        rays: float32 [n, 3], not normalised.
        lengths: float32 [n], ray parameter of the hit.
        triangle: int32 [n], index of the triangle that is hit; -1 for none.
        u: float32 [n], barycentric weight of the triangle's second corner.
        v: float32 [n], barycentric weight of the triangle's third corner.
        geometric: float32 [n, 3], normal of the triangle, with any length and orientation.
        corner_normals: float32 [T, 3, 3], shading normals of the triangle corners.
        triangle_part: int32 [T], part of each triangle.
        lift: Offset of secondary ray origins from the surface, relative to the depth (at least 1 m).
        part: int32 [n], output; -1 for no hit.
        depth: float32 [n], output; 0 for no hit.
        points: float32 [n, 3], output: surface points.
        starts: float32 [n, 3], output: origins of secondary rays.
        normals: float32 [n, 3], output: shading normals, facing the eye.
        facing: float32 [n], output: cosine of the angle of incidence.
    """
    for n in range(len(rays)):
        t = triangle[n]
        if t < 0:
            part[n] = -1
            depth[n] = 0
            facing[n] = 0
            points[n] = eye
            starts[n] = eye
            normals[n, 0], normals[n, 1], normals[n, 2] = 0, 0, 1
            continue
        part[n] = triangle_part[t]
        z = lengths[n]
        depth[n] = z
        rx, ry, rz = rays[n, 0], rays[n, 1], rays[n, 2]
        gx, gy, gz = geometric[n, 0], geometric[n, 1], geometric[n, 2]
        scale = 1 / np.sqrt(max(gx * gx + gy * gy + gz * gz, np.float32(1e-30)))
        towards = gx * rx + gy * ry + gz * rz
        if towards > 0:
            scale = -scale
        gx, gy, gz = gx * scale, gy * scale, gz * scale
        facing[n] = abs(towards * scale) / np.sqrt(rx * rx + ry * ry + rz * rz)
        w = 1 - u[n] - v[n]
        a = corner_normals[t]
        nx = a[0, 0] * w + a[1, 0] * u[n] + a[2, 0] * v[n]
        ny = a[0, 1] * w + a[1, 1] * u[n] + a[2, 1] * v[n]
        nz = a[0, 2] * w + a[1, 2] * u[n] + a[2, 2] * v[n]
        scale = 1 / np.sqrt(max(nx * nx + ny * ny + nz * nz, np.float32(1e-12)))
        if nx * gx + ny * gy + nz * gz < 0:
            scale = -scale
        normals[n, 0], normals[n, 1], normals[n, 2] = nx * scale, ny * scale, nz * scale
        above = lift * max(z, np.float32(1))
        points[n, 0], points[n, 1], points[n, 2] = eye[0] + rx * z, eye[1] + ry * z, eye[2] + rz * z
        starts[n, 0] = points[n, 0] + gx * above
        starts[n, 1] = points[n, 1] + gy * above
        starts[n, 2] = points[n, 2] + gz * above


@compiled
def to_own_frames(
    order: npt.NDArray[np.int64],
    part: Integers,
    points: Floats,
    normals: Floats,
    turns: Floats,
    shifts: Floats,
    own_points: Floats,
    own_normals: Floats,
) -> None:
    """Transform points and normals to the frames of their parts.

    Args:
        order: int64 [n], index of the input point for each output row.
        part: int32 [n], part of each point; -1 for none.
        points: float32 [n, 3], points in the room.
        normals: float32 [n, 3], normals in the room.
        turns: float32 [P, 3, 3], rotation from each part's frame to the room's.
        shifts: float32 [P, 3], origin of each part's frame in the room.
        own_points: float32 [n, 3], output, in the given order.
        own_normals: float32 [n, 3], output, in the given order.
    """
    for k in range(len(order)):
        n = order[k]
        if part[n] < 0:
            continue
        turn, shift = turns[part[n]], shifts[part[n]]
        x, y, z = points[n, 0] - shift[0], points[n, 1] - shift[1], points[n, 2] - shift[2]
        for c in range(3):
            own_points[k, c] = x * turn[0, c] + y * turn[1, c] + z * turn[2, c]
            own_normals[k, c] = normals[n, 0] * turn[0, c] + normals[n, 1] * turn[1, c] + normals[n, 2] * turn[2, c]


@compiled
def rays_to_samples(starts: Floats, samples: Floats, width: int, tile: int, rays: Floats) -> None:
    """Write the ray [n, 3] from each start to the sample [tile * tile, 3] at its pixel's position in the tile."""
    for n in range(len(starts)):
        sample = samples[(n // width % tile) * tile + n % width % tile]
        for c in range(3):
            rays[n, c] = sample[c] - starts[n, c]


@compiled
def rays_about_normals(normals: Floats, samples: Floats, width: int, tile: int, rays: Floats) -> None:
    """Write a random ray [n, 3] around each normal: normal + its tile's sample [tile * tile, 3] of the unit sphere."""
    for n in range(len(normals)):
        sample = samples[(n // width % tile) * tile + n % width % tile]
        for c in range(3):
            rays[n, c] = np.float32(1.001) * normals[n, c] + sample[c]


@compiled
def smooth_along(
    down: int,
    right: int,
    values: Floats,
    part: Integers,
    depth: Floats,
    normals: Floats,
    radius: int,
    out: Floats,
) -> None:
    """Average noisy light along one axis over neighbours on the same smooth surface.

    Args:
        down: 1 for neighbours in the same column, else 0.
        right: 1 for neighbours in the same row, else 0.
        values: float32 [H, W, C].
        part: int32 [H, W], part visible in each pixel; -1 for none.
        depth: float32 [H, W], metres.
        normals: float32 [H, W, 3], unit length.
        radius: Number of pixels to each side.
        out: float32 [H, W, C], output.
    """
    height, width, channels = values.shape
    for i in range(height):
        for j in range(width):
            here, z = part[i, j], depth[i, j]
            nx, ny, nz = normals[i, j, 0], normals[i, j, 1], normals[i, j, 2]
            weight = np.float32(0)
            for c in range(channels):
                out[i, j, c] = 0
            before, after = i * down + j * right, (height - 1 - i) * down + (width - 1 - j) * right
            for step in range(-min(radius, before), min(radius, after) + 1):
                y, x = i + step * down, j + step * right
                if part[y, x] != here or abs(depth[y, x] - z) > np.float32(0.03) * z:
                    continue
                if nx * normals[y, x, 0] + ny * normals[y, x, 1] + nz * normals[y, x, 2] < np.float32(0.8):
                    continue
                weight += 1
                for c in range(channels):
                    out[i, j, c] += values[y, x, c]
            for c in range(channels):
                out[i, j, c] /= weight


@compiled
def reflected_light(
    eye: Floats,
    points: Floats,
    normals: Floats,
    surface: Floats,
    gloss: Floats,
    visible: Floats,
    places: Floats,
    lights: Floats,
    reaches: Floats,
    ambient: Floats,
    out: Floats,
) -> None:
    """Compute the light reflected by each point: ambient light plus a diffuse and a Blinn-Phong term per light source.

    Args:
        eye: float32 [3].
        points: float32 [n, 3].
        normals: float32 [n, 3], unit length.
        surface: float32 [n, 3], surface colours, gamma encoded with exponent 2, 0 to 1.
        gloss: float32 [n], 0 to 1.
        visible: float32 [n, L + 1], visible share of each light source; the last column is the ambient openness.
        places: float32 [L, 3], positions of the light sources.
        lights: float32 [L, 3], irradiance at distance `reaches`.
        reaches: float32 [L], reference distances, metres.
        ambient: float32 [2, 3], ambient light from below and from above.
        out: float32 [n, 3], output: linear light.
    """
    lamps = len(places)
    for n in range(len(points)):
        nx, ny, nz = normals[n, 0], normals[n, 1], normals[n, 2]
        ex, ey, ez = eye[0] - points[n, 0], eye[1] - points[n, 1], eye[2] - points[n, 2]
        scale = 1 / np.sqrt(max(ex * ex + ey * ey + ez * ez, np.float32(1e-12)))
        ex, ey, ez = ex * scale, ey * scale, ez * scale
        r = min(max(surface[n, 0], np.float32(0.02)), np.float32(1)) ** 2
        g = min(max(surface[n, 1], np.float32(0.02)), np.float32(1)) ** 2
        b = min(max(surface[n, 2], np.float32(0.02)), np.float32(1)) ** 2
        up = np.float32(0.5) + np.float32(0.5) * nz
        openness = np.float32(0.12) + np.float32(0.88) * visible[n, lamps]
        red = (ambient[0, 0] * (1 - up) + ambient[1, 0] * up) * openness * r
        green = (ambient[0, 1] * (1 - up) + ambient[1, 1] * up) * openness * g
        blue = (ambient[0, 2] * (1 - up) + ambient[1, 2] * up) * openness * b
        for k in range(lamps):
            lx, ly, lz = places[k, 0] - points[n, 0], places[k, 1] - points[n, 1], places[k, 2] - points[n, 2]
            square = max(lx * lx + ly * ly + lz * lz, np.float32(1e-6))
            strength = visible[n, k] * reaches[k] * reaches[k] / square
            if strength <= 0:
                continue
            scale = 1 / np.sqrt(square)
            lx, ly, lz = lx * scale, ly * scale, lz * scale
            diffuse = strength * max(nx * lx + ny * ly + nz * lz, np.float32(0))
            red += diffuse * lights[k, 0] * r
            green += diffuse * lights[k, 1] * g
            blue += diffuse * lights[k, 2] * b
            if gloss[n] > 0:
                hx, hy, hz = lx + ex, ly + ey, lz + ez
                scale = 1 / np.sqrt(max(hx * hx + hy * hy + hz * hz, np.float32(1e-12)))
                glint = (nx * hx + ny * hy + nz * hz) * scale
                if glint > np.float32(0.6):
                    shine = strength * np.float32(0.45) * gloss[n] * glint ** (8 + 90 * gloss[n])
                    red += shine * lights[k, 0]
                    green += shine * lights[k, 1]
                    blue += shine * lights[k, 2]
        out[n, 0], out[n, 1], out[n, 2] = red, green, blue
