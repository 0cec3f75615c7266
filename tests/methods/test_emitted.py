"""What single Gaussians emit, for baking, agrees with what pixels show."""

import dataclasses

import torch

from ringlight.methods.table import METHODS
from ringlight.models.splats import SplatModel
from ringlight.rasterize.choose import rasterizer_for
from tiny_scene import tiny_scene


def test_a_gaussian_alone_emits_what_a_pixel_full_of_it_shows():
    scene = tiny_scene()
    recipe = dataclasses.replace(METHODS["ringlight-mirror"], steps=10)
    model = recipe.build(scene, rasterizer_for("auto"), seed=0).model
    model.get_buffer("shader.lit").fill_(True)
    with torch.no_grad():
        model.shader.mlp[-1].weight.mul_(20)  # so that shading is a good part of the colour
    camera = scene.train[0].camera
    row = int(camera.depths(model.gaussians.means).argmin())
    alone = model.gaussians.rows(torch.tensor([row]))
    wide = dataclasses.replace(alone, log_scales=torch.zeros(1, 3) + 1, opacity_logits=torch.tensor([20.0]))
    single = SplatModel(wide, model.color, model.shader, model.rasterize, model.options)
    pixel = camera.world_to_camera[:3] @ torch.cat([wide.means[0].detach(), torch.ones(1)])
    x, y = (float(pixel[a] / pixel[2]) * camera.focal[a] + camera.center[a] for a in range(2))
    with torch.no_grad():
        shown = single.render(camera, torch.zeros(3)).color[int(y), int(x)]
    assert (single.emitted(wide, camera)[0] - wide.appearance["base"][0].sigmoid()).abs().max() > 0.05
    torch.testing.assert_close(single.emitted(wide, camera)[0], shown.clamp(0, 1), atol=0.02, rtol=0)
