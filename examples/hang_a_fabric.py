"""A piece of plain weave hangs by its last row until it rests: yarn by yarn, and in a bounding volume. Then a knit.

At rest the grip carries the weight of the fabric. A bounding volume has fewer ways to move, so the fabric hardly falls.
"""

import numpy as np

import yarnscale as ys

yarn = ys.YarnMaterial.preset("hylc2020-basket")
shape = ys.settled(ys.patterns.build("plain"), yarn)
fabric = ys.RodFabric.cut(shape.pattern, yarn, columns=3, rows=4)  # loops of the relaxed cell, glued borders
loads = ys.sheet_scenes.hang(fabric.sheet)
to_rest = ys.Schedule(duration=0.1, time_step=1 / 120)  # dynamics, then steps without inertia

volume = ys.BoundingVolume.around(fabric.sheet.vertices, (5, 5))
scenes = {
    "every yarn": ys.RodScene(fabric, loads, schedule=to_rest),
    "in a volume": ys.RodScene(fabric, loads, schedule=to_rest, volume=volume),
}
drops = []
for name, scene in scenes.items():
    result = ys.run(scene)
    grip = loads.holds(result.state.time).forces(scene.energy, result.state.x).sum(axis=0)
    weight = 9.81 * scene.energy.masses().sum()
    drops.append(result.measures["lower_edge_drop"])
    print(f"{name}: {result.summary()['status']}, {grip[1] / weight:.4f} of the weight, {1e3 * drops[-1]:.3f} mm")
    assert result.succeeded and result.measures["passages"] == 0
assert np.isclose(grip[1], weight, rtol=0.02) and abs(drops[1]) < 0.1 * drops[0]

knit = ys.jersey(6, 6, ys.YarnMaterial.preset("wool"))
around = ys.BoundingVolume.around(knit.control, (5, 5))
result = ys.run(ys.SplineScene(knit, schedule=ys.Schedule(0.2, 1 / 240, to_rest=False), volume=around))
counts = result.summary()
unknowns = {name: counts[name] for name in ("unknowns", "reduced_unknowns", "row_unknowns", "cell_unknowns")}
print(f"jersey in a homogenized volume: {unknowns}")
assert result.succeeded and counts["reduced_unknowns"] - counts["row_unknowns"] == 75
