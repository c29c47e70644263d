"""The paper's network (Fig. 1; Mildenhall et al. 2021).

Nine layers of 256, ReLU; the encoded position joins again at the fifth; the ninth also gives the density; a tenth of
128 takes the direction; a sigmoid gives the colour.
"""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from nerfmodal.field.encodings import DIRECTION_BANDS, POSITION_BANDS, positional_encoding, spherical_angles

LAYERS = 9
SKIP = 5


class RadianceField(nn.Module):
    """Density and colour of a point seen from a direction.

    Parameters
    ----------
    width
        Neurons of the nine layers (the paper: 256); the tenth has half of them.
    """

    def __init__(self, width: int = 256) -> None:
        super().__init__()
        position, direction = 6 * POSITION_BANDS, 4 * DIRECTION_BANDS  # eq 6: three coordinates; eq 7: two angles
        inputs = [position, *[width] * (LAYERS - 1)]
        inputs[SKIP - 1] += position
        self.layers = nn.ModuleList(nn.Linear(size, width) for size in inputs)
        self.density = nn.Linear(width, 1)
        self.view = nn.Linear(width + direction, width // 2)
        self.color = nn.Linear(width // 2, 3)

    def forward(
        self, positions: Float[Tensor, "points 3"], directions: Float[Tensor, "points 3"]
    ) -> tuple[Float[Tensor, " points"], Float[Tensor, "points 3"]]:
        """Density per unit of the scaled space, and RGB in [0, 1]; positions lie in [-1, 1]."""
        encoded = positional_encoding(positions, POSITION_BANDS)
        hidden = encoded
        for number, layer in enumerate(self.layers, start=1):
            joined = torch.cat([hidden, encoded], dim=-1) if number == SKIP else hidden
            hidden = torch.relu(layer(joined))
        seen = positional_encoding(spherical_angles(directions), DIRECTION_BANDS)
        features = torch.relu(self.view(torch.cat([hidden, seen], dim=-1)))
        density = nn.functional.softplus(self.density(hidden)[:, 0] - 1.0)  # a ReLU here can die at the start
        return density, torch.sigmoid(self.color(features))
