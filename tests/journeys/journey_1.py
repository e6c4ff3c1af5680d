"""Tutorial 1: a hammer campaign, from the folder to the table of modes."""

import acquisition
import ema

campaign = acquisition.open_campaign("datasets/virtual_table_hammer")
run   = campaign["beam_1kN"]                            # F_N = 1.02 +- 0.03 kN
frfs  = ema.estimate.hammer(run)                        # FrfSet, accelerance, 80 x 2
poles = ema.fit.stabilise(frfs.band(200, 1350), orders=range(4, 61, 2))
modes = ema.fit.modes(frfs, poles)                      # automatic; or near=[500, 1000]
print(modes.table())                                    # f [Hz], zeta [%], +-, MPC, F_N [N]
