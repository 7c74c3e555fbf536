"""The paper's experiments (VISAPP 2013, section 4) reproduced on recordings with ground truth."""
