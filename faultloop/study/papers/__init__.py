"""One module a seed paper: its cases, its published figures, and ours.

- ``adaptive_kalman`` (000): Zhang Zhe, Chen Deshu, "Application of the adaptive Kalman filter in computer
  relaying" (Chinese; the text names neither journal nor year).
- ``mstukf`` (001): Wang Yi, Liu Heng and others, "Transient voltage disturbance detection based on modified
  strong tracking UKF", Power System Protection and Control 2017, doi 10.7667/PSPC161472.
- ``taylor_kalman`` (002): Wu Zhili, Zhao Qingsheng and others, "Research on a synchrophasor measurement
  algorithm based on Kalman filtering at low sampling frequency" (Chinese), Power System Protection and
  Control 2014 (15), pp. 94-99.
- ``ckmc`` (003): Zhao Zhilei, Huang Jidong, Wang Yi, Yang Zhiwei, "Dynamic state estimation of generators
  based on CKMC-CKF under non-Gaussian noise", Guangdong Electric Power 2024 (3).
- ``rls`` (004): Li Liezhong, Zhou Chao, "The application of recursive least squares in microprocessor
  protection" (Chinese), 1993 (the text does not name the journal).
"""
